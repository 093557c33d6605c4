//! Paints a contact sheet: `contact_sheet OUT.png [SIDE] [COLUMNS] [FAMILY|all|random] [FIRST_SEED]`.
//! With `all`, every row is a family; otherwise six rows of one family or of random recipes.

use impasto_paintings::{Family, Recipe, label, paint};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let word = |k: usize, default: &str| arguments.get(k).map_or(default.to_owned(), Clone::clone);
    let (out, side, columns) = (
        word(0, "contact_sheet.png"),
        word(1, "256").parse()?,
        word(2, "6").parse::<u32>()?,
    );
    let (which, first) = (word(3, "all"), word(4, "0").parse::<u64>()?);
    let rows: Vec<Option<Family>> = if which == "all" {
        Family::ALL.iter().copied().map(Some).collect()
    } else {
        vec![
            Family::ALL
                .iter()
                .copied()
                .find(|f| f.name().contains(&which));
            6
        ]
    };
    let mut sheet = image::RgbImage::new(columns * side, rows.len() as u32 * side);
    for (row, family) in rows.iter().enumerate() {
        let begun = std::time::Instant::now();
        for column in 0..columns {
            let seed = first
                + if which == "all" {
                    0
                } else {
                    row as u64 * u64::from(columns)
                }
                + u64::from(column);
            let recipe = family.map_or_else(|| Recipe::random(seed), |f| Recipe::nth_of(f, seed));
            let picture = paint(&recipe, side, side);
            image::imageops::replace(
                &mut sheet,
                &picture,
                i64::from(column * side),
                row as i64 * i64::from(side),
            );
            if column == 0 {
                #[allow(clippy::print_stdout, reason = "an example reports what it painted")]
                {
                    println!("row {row}: {}", label(&recipe));
                }
            }
        }
        #[allow(clippy::print_stdout, reason = "an example reports its speed")]
        {
            println!(
                "    {:.0} ms each",
                begun.elapsed().as_secs_f64() * 1e3 / f64::from(columns)
            );
        }
    }
    sheet.save(&out)?;
    Ok(())
}

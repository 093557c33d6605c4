//! Tables of numbers.

use super::words::{e100, number, share, title};
use super::{Row, least, ordered, range_of, two_dimensional};
use crate::consistency::{Consistency, RANGES};
use crate::evaluate::{Evaluation, MethodResult, PHOTO};
use crate::guards::Guard;
use crate::page::escaped;

/// All tables: consistency at both ranges, by true depth where it is known, and by estimated flow.
pub(super) fn all(evaluation: &Evaluation) -> String {
    let rows = ordered(evaluation);
    if evaluation.frames == 0 {
        let note = "There was no walk, so nothing is said of consistency.";
        return table(evaluation, &rows, None, ("Style and content", note));
    }
    let titles = ["Short-range consistency", "Long-range consistency"];
    let exact = titles.into_iter().enumerate().map(|(range, title)| {
        let note = format!(
            "Frames <var>t</var> and <var>t</var> − {}, flow {}. {}",
            RANGES[range],
            evaluation.flow,
            compared(&rows, range),
        );
        table(evaluation, &rows, Some(range), (title, &note))
    });
    let tables = exact.collect::<String>();
    tables + &true_depth(evaluation, &rows) + &legacy(&rows)
}

/// What the column of ratios is relative to.
fn compared(rows: &[Row<'_>], range: usize) -> String {
    match least(rows, range, two_dimensional) {
        Some((name, _)) => {
            let (name, how) = title(name);
            format!(
                "“× best 2-D” is E over that of {} ({how}), the lowest of the compared \
                 two-dimensional methods that pass the guards.",
                escaped(&name)
            )
        }
        None if rows.iter().all(|(_, row)| range_of(row, range).is_none()) => {
            "No two frames share enough to be compared; a walk of more frames (--frames) takes \
             smaller steps."
                .to_owned()
        }
        None => "No two-dimensional method that passes the guards was compared.".to_owned(),
    }
}

/// A column's name, what it means, and a row's cell.
type Column<'a> = (
    &'static str,
    &'static str,
    Box<dyn Fn(&Row<'_>) -> String + 'a>,
);

/// What is measured of a pair of frames at a range.
fn consistency_columns<'a>(rows: &'a [Row<'a>], range: usize) -> Vec<Column<'a>> {
    let of = move |(_, result): &Row<'_>, show: fn(&Consistency) -> String| {
        range_of(result, range).map_or_else(|| "–".to_owned(), show)
    };
    let best = least(rows, range, |name| name != PHOTO);
    let best_flat = least(rows, range, two_dimensional);
    let counted = move |(_, result): &Row<'_>| {
        let found = [result.short, result.long].into_iter().nth(range).flatten();
        found.map_or_else(String::new, |c| format!("{} ({})", c.pairs, c.dropped))
    };
    vec![
        (
            "E×100",
            "squared difference × 100",
            Box::new(move |row| {
                let cell = of(row, e100);
                match best.is_some_and(|(name, _)| name == row.0) {
                    true => format!("<strong>{cell}</strong>"),
                    false => cell,
                }
            }),
        ),
        (
            "× best 2-D",
            "E relative to the best two-dimensional method's",
            Box::new(move |row| {
                let ratio = range_of(row.1, range).zip(best_flat);
                let ratio = ratio.map(|(found, (_, best))| number(found.e100 / best, 2));
                ratio.unwrap_or_else(|| "–".to_owned())
            }),
        ),
        (
            "× photo",
            "E relative to the unstylised render's, contrast divided out of both",
            Box::new(move |(_, result)| {
                let ratio = result
                    .over_photo
                    .map(|ratio| [ratio.short, ratio.long][range]);
                let ratio = ratio.filter(|ratio| ratio.is_finite());
                ratio.map_or_else(|| "–".to_owned(), |ratio| number(ratio, 2))
            }),
        ),
        (
            "RMSE",
            "mean root of E",
            Box::new(move |row| of(row, |c| number(c.rmse, 4))),
        ),
        (
            "RMSE all",
            "the same with occluded pixels",
            Box::new(move |row| of(row, |c| number(c.rmse_all, 4))),
        ),
        (
            "VGG",
            "perceptual distance, unweighted",
            Box::new(move |row| {
                of(row, |c| {
                    c.vgg_unweighted.map_or("–".into(), |v| number(v, 3))
                })
            }),
        ),
        (
            "Coverage",
            "pixels compared",
            Box::new(move |row| of(row, |c| share(c.coverage))),
        ),
        (
            "Pairs",
            "pairs that count, and in brackets those dropped because too little of them does",
            Box::new(counted),
        ),
    ]
}

/// What consistency is worth nothing without.
fn guard_columns<'a>() -> Vec<Column<'a>> {
    vec![
        (
            "Style gain",
            "share of the style distance that stylising removed",
            Box::new(|(_, result)| number(result.fidelity.style_gain, 3)),
        ),
        (
            "Retrieval",
            "views nearest to their own painting",
            Box::new(|(_, result)| share(result.fidelity.retrieval)),
        ),
        (
            "Content",
            "content distance to the unstylised view",
            Box::new(|(_, result)| number(result.fidelity.content_loss, 2)),
        ),
        (
            "Sharpness",
            "gradient energy relative to the unstylised frames",
            Box::new(|(_, result)| result.sharpness.map_or("–".into(), |s| number(s, 2))),
        ),
    ]
}

/// What a reader must know before believing a row.
fn verdict(rows: &[Row<'_>], range: Option<usize>, (name, result): &Row<'_>) -> String {
    if *name == PHOTO {
        return "the floor".to_owned();
    }
    let failed = Guard::failed(name, result);
    if failed.is_empty() {
        return "passes".to_owned();
    }
    let reasons: Vec<String> = failed.iter().map(ToString::to_string).collect();
    let reasons = reasons.join(", ");
    let e = |row: &Row<'_>| range.and_then(|range| Some(range_of(row.1, range)?.e100));
    let others = rows
        .iter()
        .filter(|(other, _)| *other != PHOTO && other != name);
    let wins = e(&(name, result)).is_some_and(|own| {
        let mut others = others.filter_map(e).peekable();
        others.peek().is_some() && others.all(|other| own < other)
    });
    let text = match wins {
        true => format!("lowest E of all, but {reasons}: not a win"),
        false => reasons,
    };
    format!("<em>{}</em>", escaped(&text))
}

fn table(
    evaluation: &Evaluation,
    rows: &[Row<'_>],
    range: Option<usize>,
    (title, note): (&str, &str),
) -> String {
    let consistency = range.map_or_else(Vec::new, |range| consistency_columns(rows, range));
    let guards = guard_columns();
    let groups = [
        ("Consistency", consistency.len()),
        ("Guards", guards.len() + 1),
    ];
    let groups = groups.into_iter().filter(|(_, count)| *count > 0);
    let groups: String = groups
        .map(|(name, count)| format!("<th colspan=\"{count}\" scope=\"colgroup\">{name}</th>"))
        .collect();
    let columns: Vec<Column<'_>> = consistency.into_iter().chain(guards).collect();
    let names = columns.iter().map(|(name, meaning, _)| {
        format!(
            "<th scope=\"col\" title=\"{}\">{name}</th>",
            escaped(meaning)
        )
    });
    let body = rows.iter().map(|row| {
        let cells = columns
            .iter()
            .map(|(_, _, cell)| format!("<td>{}</td>", cell(row)));
        format!(
            "<tr>{}{}<td class=\"words\">{}</td></tr>\n",
            heading(row.0),
            cells.collect::<String>(),
            verdict(rows, range, row),
        )
    });
    let missing = evaluation.unavailable.iter().map(|(name, reason)| {
        format!(
            "<tr class=\"missing\"><th scope=\"row\">{}</th><td class=\"words\" colspan=\"{}\">\
             <span>not available: {}</span></td></tr>\n",
            escaped(&title_of(name)),
            columns.len() + 1,
            escaped(reason),
        )
    });
    framed(
        (title, note),
        &format!(
            "<tr><td></td>{groups}</tr>\n<tr><th scope=\"col\">Method</th>{}<th scope=\"col\" \
             class=\"words\">In words</th></tr>",
            names.collect::<String>()
        ),
        &(body.collect::<String>() + &missing.collect::<String>()),
    )
}

fn title_of(name: &str) -> String {
    title(name).0
}

fn heading(method: &str) -> String {
    let (name, how) = title(method);
    format!(
        "<th scope=\"row\">{}<small>{how}</small></th>",
        escaped(&name)
    )
}

/// By the depth that a built scene really has.
fn true_depth(evaluation: &Evaluation, rows: &[Row<'_>]) -> String {
    let Some(error) = evaluation.depth_error else {
        return String::new();
    };
    let note = format!(
        "The same with flow from the depth that the scene was built with: the model's own depth \
         cannot flatter it here. Rendered depth differs from it by {:.2} % in the median.",
        100.0 * error
    );
    let found = |result: &MethodResult| {
        let truth = result.true_depth?;
        Some([truth.short, truth.long])
    };
    both_ranges(("Consistency by true depth", &note), rows, found)
}

/// By flow estimated from the frames, under its own name.
fn legacy(rows: &[Row<'_>]) -> String {
    let note = "The same with flow estimated from the unstylised frames, as papers without \
                geometry report it (Lai et al. 2018). Estimates smear occlusions, so that these \
                numbers are not those above.";
    let found = |result: &MethodResult| {
        let estimated = result.estimated_flow?;
        Some([estimated.short, estimated.long])
    };
    both_ranges(("Consistency by estimated flow", note), rows, found)
}

/// Short and long range in one table, of the methods that have them.
fn both_ranges(
    titled: (&str, &str),
    rows: &[Row<'_>],
    found: impl Fn(&MethodResult) -> Option<[Consistency; 2]>,
) -> String {
    type Cell = fn(&Consistency) -> String;
    let columns: [(&str, Cell); 5] = [
        ("E×100", e100),
        ("RMSE", |c| number(c.rmse, 4)),
        ("RMSE all", |c| number(c.rmse_all, 4)),
        ("Coverage", |c| share(c.coverage)),
        ("Pairs", |c| format!("{} ({})", c.pairs, c.dropped)),
    ];
    let names = columns.map(|(name, _)| format!("<th scope=\"col\">{name}</th>"));
    let names = names.concat();
    let body = rows.iter().filter_map(|(name, result)| {
        let cells = found(result)?.map(|c| {
            let cells = columns.map(|(_, cell)| format!("<td>{}</td>", cell(&c)));
            cells.concat()
        });
        Some(format!("<tr>{}{}</tr>\n", heading(name), cells.concat()))
    });
    let width = columns.len();
    framed(
        titled,
        &format!(
            "<tr><td></td><th colspan=\"{width}\" scope=\"colgroup\">Short range</th>\
             <th colspan=\"{width}\" scope=\"colgroup\">Long range</th></tr>\n\
             <tr><th scope=\"col\">Method</th>{names}{names}</tr>"
        ),
        &body.collect::<String>(),
    )
}

/// A table under its title; wider ones than the window scroll by themselves.
fn framed((title, note): (&str, &str), head: &str, body: &str) -> String {
    format!(
        "<section>\n<h2>{title}</h2>\n<p>{note}</p>\n<div class=\"wide\" tabindex=\"0\"><table>\n\
         <thead>\n{head}\n</thead>\n<tbody>\n{body}</tbody>\n</table></div>\n</section>\n"
    )
}

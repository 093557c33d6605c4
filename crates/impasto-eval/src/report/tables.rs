//! Tables of numbers.

use super::rows::{Row, least, ordered, range_of};
use super::words::{self, e100, number, share};
use crate::consistency::{ByRange, Consistency, RANGES};
use crate::guards::FailedGuard;
use crate::html::escaped;
use crate::names::{PHOTO, two_dimensional};
use crate::results::{Evaluation, MethodResult};

/// All tables: consistency at both ranges, by true depth where it is known, and by estimated flow.
pub(super) fn all(evaluation: &Evaluation) -> String {
    let rows = ordered(evaluation);
    if evaluation.frames == 0 {
        let note = "There was no walk, so nothing is said of consistency.";
        return table(evaluation, &rows, None, "Style and content", note);
    }
    let titles = ["Short-range consistency", "Long-range consistency"];
    let exact = titles.into_iter().enumerate().map(|(range, title)| {
        let note = format!(
            "Frames <var>t</var> and <var>t</var> − {}, flow {}. {}",
            RANGES[range],
            evaluation.flow,
            compared(&rows, range),
        );
        table(evaluation, &rows, Some(range), title, &note)
    });
    let tables = exact.collect::<String>();
    tables + &true_depth(evaluation, &rows) + &estimated_flow(&rows)
}

/// What the column of ratios is relative to.
fn compared(rows: &[Row<'_>], range: usize) -> String {
    match least(rows, range, two_dimensional) {
        Some((name, _)) => {
            let (name, how) = words::title(name);
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

/// What a consistency table's cells are relative to.
struct Scope<'a> {
    range: usize,
    /// The method of least E that passes the guards.
    best: Option<&'a str>,
    /// The least E of the two-dimensional methods that pass them.
    best_flat: Option<f64>,
}

/// A column's name, what it means, and a row's cell.
type Column<T> = (&'static str, &'static str, T);
type OfConsistency = fn(&Consistency) -> String;
type OfScope = fn(&Scope<'_>, &Row<'_>) -> String;
type OfResult = fn(&MethodResult) -> String;

const E: Column<OfConsistency> = ("E×100", "squared difference × 100", e100);

/// What a range's E is compared with.
const RELATIVE: [Column<OfScope>; 3] = [
    (E.0, E.1, |scope, (name, result)| {
        let cell = range_of(result, scope.range).map_or_else(|| number(None, 0), e100);
        if scope.best == Some(*name) {
            format!("<strong>{cell}</strong>")
        } else {
            cell
        }
    }),
    (
        "× best 2-D",
        "E relative to the best two-dimensional method's",
        |scope, (_, result)| {
            let ratio = range_of(result, scope.range).zip(scope.best_flat);
            number(ratio.map(|(found, best)| found.e100 / best), 2)
        },
    ),
    (
        "× photo",
        "E relative to the unstylised render's, contrast divided out of both",
        |scope, (_, result)| {
            let ratio = result.over_photo.as_ref();
            number(ratio.map(|ratio| *ratio.each_ref()[scope.range]), 2)
        },
    ),
];

/// What is measured of a pair of frames beside E. Where no pair counts, nothing is a number.
const MEASURES: [Column<OfConsistency>; 5] = [
    ("RMSE", "mean root of E", |c| number(c.rmse, 4)),
    ("RMSE all", "the same with occluded pixels", |c| {
        number(c.rmse_all, 4)
    }),
    (VGG, "perceptual distance, unweighted", |c| {
        number(c.vgg_unweighted, 3)
    }),
    ("Coverage", "pixels compared", |c| share(c.coverage)),
    (
        "Pairs",
        "pairs that count, and in brackets those dropped because too little of them does",
        |c| format!("{} ({})", c.pairs, c.dropped),
    ),
];
const VGG: &str = "VGG";

/// What consistency is worth nothing without.
const GUARDS: [Column<OfResult>; 6] = [
    (
        "Style gain",
        "share of the style distance that stylising removed",
        |result| number(result.fidelity.style_gain, 3),
    ),
    (
        "Retrieval",
        "views nearest to their own painting",
        |result| share(result.fidelity.retrieval),
    ),
    (
        "Stroke score",
        "how much nearer to the painting's strokes than a cheat by colour or grain; 1 is another \
         piece of the painting",
        |result| number(result.strokes.map(|s| s.stroke_score), 3),
    ),
    (
        "Stroke retrieval",
        "paintings whose own render of a view has the nearest strokes of all",
        |result| {
            let found = result.strokes.map(|s| s.stroke_retrieval);
            share(found.unwrap_or(f64::NAN))
        },
    ),
    (
        "Content",
        "content distance to the unstylised view",
        |result| number(result.fidelity.content_loss, 2),
    ),
    (
        "Sharpness",
        "gradient energy relative to the unstylised frames",
        |result| number(result.sharpness, 2),
    ),
];

/// A row's cells of consistency at a range.
fn consistency_cells(scope: &Scope<'_>, row: &Row<'_>) -> Vec<String> {
    let found = row.1.consistency.as_ref();
    let found = found.map(|found| found.each_ref()[scope.range]);
    let relative = RELATIVE.iter().map(|(.., cell)| cell(scope, row));
    let measures = MEASURES
        .iter()
        .map(|(.., cell)| found.map_or_else(String::new, cell));
    relative.chain(measures).collect()
}

/// What a reader must know before believing a row.
fn verdict(rows: &[Row<'_>], range: Option<usize>, row: &Row<'_>) -> String {
    let (name, result) = *row;
    if name == PHOTO {
        return "the floor".to_owned();
    }
    let failed = FailedGuard::of(name, result);
    if failed.is_empty() {
        return "passes".to_owned();
    }
    let reasons: Vec<String> = failed.iter().map(ToString::to_string).collect();
    let mut text = reasons.join(", ");
    let e = |row: &Row<'_>| range.and_then(|range| Some(range_of(row.1, range)?.e100));
    let others = rows
        .iter()
        .filter(|(other, _)| *other != PHOTO && *other != name);
    let wins = e(row).is_some_and(|own| {
        let mut others = others.filter_map(e).peekable();
        others.peek().is_some() && others.all(|other| own < other)
    });
    if wins {
        text = format!("lowest E of all, but {text}: not a win");
    }
    format!("<em>{}</em>", escaped(&text))
}

fn table(
    evaluation: &Evaluation,
    rows: &[Row<'_>],
    range: Option<usize>,
    title: &str,
    note: &str,
) -> String {
    let scope = range.map(|range| Scope {
        range,
        best: least(rows, range, |name| name != PHOTO).map(|(name, _)| name),
        best_flat: least(rows, range, two_dimensional).map(|(_, e100)| e100),
    });
    let consistency = headings(&RELATIVE).chain(headings(&MEASURES));
    let consistency = consistency.filter(|_| scope.is_some());
    let names: Vec<String> = consistency.chain(headings(&GUARDS)).collect();
    let groups = [
        ("Consistency", names.len() - GUARDS.len()),
        ("Guards", GUARDS.len() + 1),
    ];
    let groups = groups.into_iter().filter(|(_, count)| *count > 0);
    let groups: String = groups
        .map(|(name, count)| format!("<th colspan=\"{count}\" scope=\"colgroup\">{name}</th>"))
        .collect();
    let body = rows.iter().map(|row| {
        let cells = scope.iter().flat_map(|scope| consistency_cells(scope, row));
        let cells = cells.chain(GUARDS.iter().map(|(.., cell)| cell(row.1)));
        format!(
            "<tr>{}{}<td class=\"words\">{}</td></tr>\n",
            heading(row.0),
            cells
                .map(|cell| format!("<td>{cell}</td>"))
                .collect::<String>(),
            verdict(rows, range, row),
        )
    });
    let missing = evaluation.unavailable.iter().map(|(name, reason)| {
        format!(
            "<tr class=\"missing\"><th scope=\"row\">{}</th><td class=\"words\" colspan=\"{}\">\
             <span>not available: {}</span></td></tr>\n",
            escaped(&words::title(name).0),
            names.len() + 1,
            escaped(reason),
        )
    });
    framed(
        title,
        note,
        &format!(
            "<tr><td></td>{groups}</tr>\n<tr><th scope=\"col\">Method</th>{}<th scope=\"col\" \
             class=\"words\">In words</th></tr>",
            names.concat()
        ),
        &body.chain(missing).collect::<String>(),
    )
}

fn headings<T>(columns: &[Column<T>]) -> impl Iterator<Item = String> {
    columns.iter().map(|(name, meaning, _)| {
        let meaning = escaped(meaning);
        format!("<th scope=\"col\" title=\"{meaning}\">{name}</th>")
    })
}

fn heading(method: &str) -> String {
    let (name, how) = words::title(method);
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
    let found = |result: &MethodResult| Some(result.true_depth?.consistency);
    both_ranges("Consistency by true depth", &note, rows, found)
}

/// By flow estimated from the frames, under its own name.
fn estimated_flow(rows: &[Row<'_>]) -> String {
    let note = "The same with flow estimated from the unstylised frames, as papers without \
                geometry report it (Lai et al. 2018). Estimates smear occlusions, so that these \
                numbers are not those above.";
    let found = |result: &MethodResult| result.estimated_flow;
    both_ranges("Consistency by estimated flow", note, rows, found)
}

/// Short and long range in one table, of the methods that have them.
fn both_ranges(
    title: &str,
    note: &str,
    rows: &[Row<'_>],
    found: fn(&MethodResult) -> Option<ByRange<Consistency>>,
) -> String {
    let measures = MEASURES.iter().filter(|(name, ..)| *name != VGG);
    let columns: Vec<_> = std::iter::once(&E).chain(measures).collect();
    let width = columns.len();
    let names = columns
        .iter()
        .map(|(name, ..)| format!("<th scope=\"col\">{name}</th>"));
    let names: String = names.collect();
    let body = rows.iter().filter_map(|(name, result)| {
        let cells = found(result)?.each_ref().map(|c| {
            let cells = columns
                .iter()
                .map(|(.., cell)| format!("<td>{}</td>", cell(c)));
            cells.collect::<String>()
        });
        Some(format!("<tr>{}{}</tr>\n", heading(name), cells.concat()))
    });
    framed(
        title,
        note,
        &format!(
            "<tr><td></td><th colspan=\"{width}\" scope=\"colgroup\">Short range</th>\
             <th colspan=\"{width}\" scope=\"colgroup\">Long range</th></tr>\n\
             <tr><th scope=\"col\">Method</th>{names}{names}</tr>"
        ),
        &body.collect::<String>(),
    )
}

/// A table under its title; wider ones than the window scroll by themselves.
fn framed(title: &str, note: &str, head: &str, body: &str) -> String {
    format!(
        "<section>\n<h2>{title}</h2>\n<p>{note}</p>\n<div class=\"wide\" tabindex=\"0\"><table>\n\
         <thead>\n{head}\n</thead>\n<tbody>\n{body}</tbody>\n</table></div>\n</section>\n"
    )
}

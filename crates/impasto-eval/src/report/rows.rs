//! Methods in the order of tables, and the best of them.

use crate::consistency::Consistency;
use crate::guards::FailedGuard;
use crate::names::{OURS, PHOTO, REFINED};
use crate::results::{Evaluation, MethodResult};

/// A method's name and results.
pub(super) type Row<'a> = (&'a str, &'a MethodResult);

/// All methods: the floor, the model's own, then the others by name.
pub(super) fn ordered(evaluation: &Evaluation) -> Vec<Row<'_>> {
    let methods = evaluation.methods.iter();
    let mut rows: Vec<Row<'_>> = methods.map(|(name, m)| (name.as_str(), m)).collect();
    // The sort keeps the order of equals.
    rows.sort_by_key(|(name, _)| match *name {
        PHOTO => 0,
        OURS => 1,
        REFINED => 2,
        _ => 3,
    });
    rows
}

/// Short range is 0, long range 1; `None` without a path or if no pair counts.
pub(super) fn range_of(result: &MethodResult, range: usize) -> Option<&Consistency> {
    let found = result.consistency.as_ref()?.each_ref()[range];
    Some(found).filter(|found| found.pairs > 0)
}

/// The least E of the methods that pass the guards and that `eligible` names.
pub(super) fn least<'a>(
    rows: &[Row<'a>],
    range: usize,
    eligible: fn(&str) -> bool,
) -> Option<(&'a str, f64)> {
    let passing = rows
        .iter()
        .filter(|(name, result)| eligible(name) && FailedGuard::of(name, result).is_empty());
    let found = passing.filter_map(|(name, result)| Some((*name, range_of(result, range)?.e100)));
    found.min_by(|a, b| a.1.total_cmp(&b.1))
}

//! Bounding-volume hierarchy over the analytic solids.

use glam::{Vec3, Vec3A};

use super::solids::{Contact, Solid};

/// Most solids that one leaf holds.
const LEAF_SIZE: usize = 3;
/// Deep enough for 2³⁰ solids: median splits halve every level.
const STACK: usize = 32;

#[derive(Debug, Clone, Copy)]
struct Node {
    low: Vec3A,
    high: Vec3A,
    /// First solid of a leaf, or the right child (the left one follows its parent).
    start: usize,
    /// Number of solids; 0 for inner nodes.
    count: usize,
}

/// The solids, sorted into a binary tree of boxes.
#[derive(Debug)]
pub struct Bvh {
    nodes: Vec<Node>,
    solids: Vec<Solid>,
}

impl Bvh {
    /// Builds the tree.
    pub fn new(mut solids: Vec<Solid>) -> Self {
        let mut nodes = Vec::with_capacity(solids.len());
        if !solids.is_empty() {
            build(&mut nodes, &mut solids, 0);
        }
        Self { nodes, solids }
    }

    /// The first solid that the ray meets before `max`.
    pub fn first_hit(&self, origin: Vec3, direction: Vec3, max: f32) -> Option<(&Solid, Contact)> {
        let mut best: Option<(&Solid, Contact)> = None;
        self.walk(origin, direction, max, |solid, limit| {
            let contact = solid.hit(origin, direction, 1e-4, limit)?;
            best = Some((solid, contact));
            Some(contact.t)
        });
        best
    }

    /// Whether anything lies on the ray.
    pub fn is_blocked(&self, origin: Vec3, direction: Vec3) -> bool {
        let mut blocked = false;
        self.walk(origin, direction, f32::INFINITY, |solid, limit| {
            blocked |= solid.hit(origin, direction, 1e-3, limit).is_some();
            blocked.then_some(f32::NEG_INFINITY)
        });
        blocked
    }

    /// Calls `visit` for every solid whose box the ray enters before the limit, nearest child
    /// first; what `visit` returns becomes the new limit.
    fn walk<'a>(
        &'a self,
        origin: Vec3,
        direction: Vec3,
        max: f32,
        mut visit: impl FnMut(&'a Solid, f32) -> Option<f32>,
    ) {
        let inverse = Vec3A::from(direction).recip();
        let eye = Vec3A::from(origin);
        let mut limit = max;
        let mut stack = [(0usize, 0.0f32); STACK];
        let mut depth = 0;
        if let Some(root) = self.nodes.first() {
            stack[0] = (0, entry(root, eye, inverse));
            depth = 1;
        }
        while depth > 0 {
            depth -= 1;
            let (index, near) = stack[depth];
            if near >= limit {
                continue;
            }
            let node = &self.nodes[index];
            if node.count > 0 {
                for solid in &self.solids[node.start..node.start + node.count] {
                    limit = visit(solid, limit).unwrap_or(limit);
                }
                continue;
            }
            let left = (index + 1, entry(&self.nodes[index + 1], eye, inverse));
            let right = (node.start, entry(&self.nodes[node.start], eye, inverse));
            let left_first = left.1 <= right.1;
            // The nearer one is pushed last and visited first.
            for child in if left_first {
                [right, left]
            } else {
                [left, right]
            } {
                if child.1 < limit {
                    stack[depth] = child;
                    depth += 1;
                }
            }
        }
    }
}

/// Ray parameter at which the box is entered, infinite when it is missed.
fn entry(node: &Node, origin: Vec3A, inverse: Vec3A) -> f32 {
    let (a, b) = (node.low - origin, node.high - origin);
    let (a, b) = (a * inverse, b * inverse);
    let near = a.min(b).max_element().max(0.0);
    let met = near <= a.max(b).min_element();
    if met { near } else { f32::INFINITY }
}

/// Appends the subtree of `solids`, the first of which has index `start` in the whole list.
fn build(nodes: &mut Vec<Node>, solids: &mut [Solid], start: usize) {
    let (mut low, mut high) = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    for solid in solids.iter() {
        let (a, b) = solid.bounds();
        (low, high) = (low.min(a), high.max(b));
    }
    let index = nodes.len();
    nodes.push(Node {
        low: low.into(),
        high: high.into(),
        start,
        count: solids.len(),
    });
    if solids.len() <= LEAF_SIZE {
        return;
    }
    let axis = (high - low).max_position();
    let centre = |solid: &Solid| {
        let (a, b) = solid.bounds();
        (a + b)[axis]
    };
    solids.sort_by(|a, b| centre(a).total_cmp(&centre(b)));
    let (left, right) = solids.split_at_mut(solids.len() / 2);
    build(nodes, left, start);
    nodes[index].start = nodes.len();
    nodes[index].count = 0;
    build(nodes, right, start + left.len());
}

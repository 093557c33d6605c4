//! Regions that grow over surfaces from a point.

use glam::Vec3;
use std::collections::HashMap;
use std::sync::Arc;

/// Cells along a unit of contracted space: about three rays of the views that they are filled from.
const CELLS: f32 = 40.0;
/// Cells around a point in which its surface is looked for.
const REACH: i16 = 3;

type Cell = [i16; 3];

/// The surfaces of a scene in cells of contracted space, each with the mean of the colours that
/// training views see in it.
#[derive(Debug, Clone, Default)]
pub(crate) struct SurfaceCells {
    cells: HashMap<Cell, Vec3>,
}

/// Cells that belong together. Fixed in the scene, so that all views agree on it.
#[derive(Debug, Clone)]
pub(crate) struct Region {
    /// Of every cell with a surface whether it belongs to the region.
    cells: Arc<HashMap<Cell, bool>>,
}

/// All of space within radius 2, the unit sphere as it is.
fn contracted(point: Vec3) -> Vec3 {
    let length = point.length();
    match length > 1.0 {
        true => point * ((2.0 - 1.0 / length) / length),
        false => point,
    }
}

fn cell(point: Vec3) -> Cell {
    (contracted(point) * CELLS)
        .floor()
        .to_array()
        .map(|x| x as i16)
}

fn around(cell: Cell, reach: i16) -> impl Iterator<Item = Cell> {
    let side = -reach..=reach;
    side.clone().flat_map(move |x| {
        let side = side.clone();
        side.clone().flat_map(move |y| {
            side.clone()
                .map(move |z| [cell[0] + x, cell[1] + y, cell[2] + z])
        })
    })
}

impl SurfaceCells {
    /// Of points on surfaces, in scene space, with their colours.
    pub(crate) fn new(points: impl Iterator<Item = (Vec3, Vec3)>) -> Self {
        let mut sums: HashMap<Cell, (Vec3, f32)> = HashMap::new();
        for (point, colour) in points.filter(|(point, _)| point.is_finite()) {
            let sum = sums.entry(cell(point)).or_default();
            sum.0 += colour;
            sum.1 += 1.0;
        }
        let cells = sums
            .into_iter()
            .map(|(cell, (sum, count))| (cell, sum / count));
        Self {
            cells: cells.collect(),
        }
    }

    /// What is connected with the surface nearest to a point through cells whose colours are no
    /// farther from its own than `tolerance`, of the way from black to white. `None` where there is
    /// no surface near.
    pub(crate) fn region(&self, point: Vec3, tolerance: f32) -> Option<Region> {
        let wanted = contracted(point) * CELLS;
        let distance = |cell: &Cell| {
            let middle = Vec3::from(cell.map(|x| f32::from(x) + 0.5));
            middle.distance_squared(wanted)
        };
        let near = around(cell(point), REACH).filter(|cell| self.cells.contains_key(cell));
        // Cells come in a fixed order, so that ties are broken alike.
        let seed = near.min_by(|a, b| distance(a).total_cmp(&distance(b)))?;
        let colour = self.cells[&seed];
        let most = tolerance * 3.0f32.sqrt();
        let mut cells: HashMap<Cell, bool> = self.cells.keys().map(|cell| (*cell, false)).collect();
        let mut edge = vec![seed];
        cells.insert(seed, true);
        while let Some(from) = edge.pop() {
            for next in around(from, 1) {
                let alike = |other: &Vec3| other.distance(colour) <= most;
                if self.cells.get(&next).is_some_and(alike)
                    && cells.insert(next, true) == Some(false)
                {
                    edge.push(next);
                }
            }
        }
        Some(Region {
            cells: Arc::new(cells),
        })
    }
}

impl Region {
    /// How much of the surface at a point belongs to it, from 0 to 1; smooth between cells.
    pub(crate) fn share(&self, point: Vec3) -> f32 {
        let at = contracted(point) * CELLS - 0.5;
        let (low, part) = (at.floor(), at - at.floor());
        let (mut all, mut own) = (0.0, 0.0);
        for corner in 0..8u8 {
            let up = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let weight: f32 = (0..3)
                .map(|i| if up[i] == 1 { part[i] } else { 1.0 - part[i] })
                .product();
            let cell = [0, 1, 2].map(|i| low[i] as i16 + i16::from(up[i]));
            if let Some(belongs) = self.cells.get(&cell) {
                all += weight;
                own += if *belongs { weight } else { 0.0 };
            }
        }
        // Where no surface was seen, as between a thing and what is behind it, nothing belongs.
        if all < 1e-3 {
            return 0.0;
        }
        let share = own / all;
        share * share * (3.0 - 2.0 * share)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two walls that do not touch, the left one half red and half blue.
    fn walls() -> SurfaceCells {
        let side = || (0..=200u8).map(|i| f32::from(i) / 200.0 - 0.5);
        let left = side().flat_map(move |y| side().map(move |z| (y, z)));
        let points = left.flat_map(|(y, z)| {
            let colour = if y < 0.0 { Vec3::X } else { Vec3::Z };
            [
                (Vec3::new(-0.5, y, z), colour),
                (Vec3::new(0.5, y, z), Vec3::X),
            ]
        });
        SurfaceCells::new(points)
    }

    #[test]
    fn a_region_ends_at_another_colour_and_at_a_gap() {
        let walls = walls();
        let region = walls.region(Vec3::new(-0.5, -0.25, 0.1), 0.2).unwrap();
        assert_eq!(region.share(Vec3::new(-0.49, -0.4, -0.4)), 1.0);
        assert_eq!(region.share(Vec3::new(-0.49, 0.3, 0.0)), 0.0);
        assert_eq!(region.share(Vec3::new(0.49, -0.3, 0.0)), 0.0);
        assert_eq!(region.share(Vec3::new(0.0, -0.3, 0.0)), 0.0);
        let all = walls.region(Vec3::new(-0.5, -0.25, 0.1), 1.0).unwrap();
        assert_eq!(all.share(Vec3::new(-0.49, 0.3, 0.0)), 1.0);
        assert_eq!(all.share(Vec3::new(0.49, 0.3, 0.0)), 0.0);
    }

    #[test]
    fn a_region_needs_a_surface() {
        assert!(walls().region(Vec3::ZERO, 0.5).is_none());
        assert!(SurfaceCells::default().region(Vec3::ZERO, 1.0).is_none());
        // Slightly off the surface, as a depth read from a picture is.
        assert!(walls().region(Vec3::new(-0.46, 0.0, 0.0), 0.5).is_some());
    }

    #[test]
    fn all_of_space_has_cells() {
        let points = [1e-3f32, 1.0, 1e3, 1e12].map(|x| (Vec3::new(x, 0.0, 0.0), Vec3::ONE));
        let far = SurfaceCells::new(
            points
                .into_iter()
                .chain([(Vec3::splat(f32::NAN), Vec3::ONE)]),
        );
        assert_eq!(far.cells.len(), 4);
        let region = far.region(Vec3::new(1e9, 0.0, 0.0), 0.1).unwrap();
        assert!(region.share(Vec3::new(1e6, 0.0, 0.0)) > 0.9);
    }
}

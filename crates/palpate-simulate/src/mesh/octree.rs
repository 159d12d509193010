//! A balanced octree, and the tetrahedra of its cells: the lattice that meshes are cut from.
//!
//! Cells of equal size give the body-centred cubic lattice: four tetrahedra around each face, from each of its edges
//! to the two cells' centres. Between sizes they are halved, quartered, or half pyramids (Labelle and Shewchuk 2007,
//! section 4). At *walls* tetrahedra end at the cells' faces, as half pyramids too, so that planes stay planes.

use crate::{Result, SimulateError};
use rayon::prelude::*;
use std::collections::{HashMap, HashSet};

/// A point of the lattice, in half edges of the finest cells: corners are even, centres may be odd.
pub(super) type Key = [i32; 3];

/// Coordinates lie below this: three of them fit in a u64.
pub(super) const MAX_COORDINATE: i32 = 1 << 20;

/// More cells than this are refused: about 16 nodes each.
const MAX_CELLS: usize = 4_000_000;

/// A cube of edge 2 · 2^level.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Cell {
    /// Lowest corner.
    pub at: Key,
    pub level: u8,
}

impl Cell {
    pub fn size(&self) -> i32 {
        2 << self.level
    }

    pub fn centre(&self) -> Key {
        self.at.map(|x| x + self.size() / 2)
    }

    pub fn corners(&self) -> [Key; 8] {
        std::array::from_fn(|i| std::array::from_fn(|a| self.at[a] + (i as i32 >> a & 1) * self.size()))
    }

    fn children(&self) -> [Cell; 8] {
        let level = self.level - 1;
        std::array::from_fn(|i| {
            let at = std::array::from_fn(|a| self.at[a] + (i as i32 >> a & 1) * self.size() / 2);
            Cell { at, level }
        })
    }

    fn moved(&self, way: Key) -> Cell {
        Cell { at: std::array::from_fn(|a| self.at[a] + way[a] * self.size()), ..*self }
    }

    fn parent(&self) -> Cell {
        let level = self.level + 1;
        Cell { at: self.at.map(|x| x & !((2 << level) - 1)), level }
    }
}

/// What becomes of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    /// Nothing of the body is in it, nor in the tetrahedra around it.
    Drop,
    Split,
    Keep,
}

/// Leaves that differ by one level at most across faces and edges.
pub(super) struct Octree {
    leaves: HashSet<Cell>,
    ordered: Vec<Cell>,
}

impl Octree {
    /// Splits the roots as `fate` says (it must not split level 0), then as balance asks.
    ///
    /// # Errors
    /// Too many cells.
    pub fn grow(roots: Vec<Cell>, fate: impl Fn(&Cell) -> Fate + Sync) -> Result<Self> {
        let mut leaves = HashSet::new();
        let mut level = roots;
        let settle = |mut cells: Vec<Cell>, leaves: &mut HashSet<Cell>| -> Result<Vec<Cell>> {
            let mut added = Vec::new();
            while !cells.is_empty() {
                let fates: Vec<Fate> = cells.par_iter().map(&fate).collect();
                let mut next = Vec::new();
                for (cell, fate) in cells.iter().zip(fates) {
                    match fate {
                        Fate::Drop => {}
                        Fate::Split => next.extend(cell.children()),
                        Fate::Keep => {
                            leaves.insert(*cell);
                            added.push(*cell);
                        }
                    }
                }
                if leaves.len() + next.len() > MAX_CELLS {
                    return Err(SimulateError::invalid(
                        "[mesh] element_size_mm",
                        format!("it asks for more than {MAX_CELLS} cells"),
                        "give a larger size",
                    ));
                }
                cells = next;
            }
            Ok(added)
        };
        level = settle(level, &mut leaves)?;
        while !level.is_empty() {
            let mut again = Vec::new();
            for cell in level.iter().filter(|c| c.level > 0) {
                // Cells that are gone already were replaced by smaller ones, which were looked at in their turn.
                if leaves.contains(cell) && Self::must_split(&leaves, cell) {
                    leaves.remove(cell);
                    again.extend(settle(cell.children().to_vec(), &mut leaves)?);
                }
            }
            // A split may unbalance the neighbours; looking at all again is simple and converges in a few rounds.
            level = if again.is_empty() { again } else { sorted(&leaves) };
        }
        let ordered = sorted(&leaves);
        Ok(Octree { leaves, ordered })
    }

    /// Whether a neighbour across a face or an edge is smaller by two levels or more.
    fn must_split(leaves: &HashSet<Cell>, cell: &Cell) -> bool {
        // Such a neighbour leaves a quarter of an edge bare: no leaf of this level, above or one below covers it.
        let half = cell.size() / 2;
        directions().any(|way| {
            // The parts of the neighbouring place that touch: of half the size.
            let place = cell.moved(way);
            if cell.level < 2 || leaves.contains(&place) || leaves.contains(&place.parent()) {
                return false;
            }
            (0..8i32).any(|i| {
                let side = |a: usize| i >> a & 1;
                let touches = (0..3).all(|a| way[a] == 0 || side(a) == i32::from(way[a] < 0));
                if !touches {
                    return false;
                }
                let part =
                    Cell { at: std::array::from_fn(|a| place.at[a] + side(a) * half), level: cell.level - 1 };
                // Split parts have leaves below; look two levels down, at the ones that touch.
                !leaves.contains(&part) && Self::has_touching(leaves, &part, way)
            })
        })
    }

    /// Whether there are leaves strictly within `part` on its side against `way`.
    fn has_touching(leaves: &HashSet<Cell>, part: &Cell, way: Key) -> bool {
        if part.level == 0 {
            return false;
        }
        part.children().iter().enumerate().any(|(i, child)| {
            let touches = (0..3).all(|a| way[a] == 0 || (i as i32 >> a & 1) == i32::from(way[a] < 0));
            touches && (leaves.contains(child) || Self::has_touching(leaves, child, way))
        })
    }

    /// All tetrahedra, as lattice points. `walls` are the coordinates, for each axis, that none may cross.
    pub fn tetrahedra(&self, walls: &[Vec<i32>; 3]) -> Vec<[Key; 4]> {
        let corners: HashSet<Key> = self.leaves.iter().flat_map(Cell::corners).collect();
        let per_cell = self.ordered.par_iter().map(|cell| self.around(cell, walls, &corners));
        per_cell.collect::<Vec<_>>().concat()
    }

    fn around(&self, cell: &Cell, walls: &[Vec<i32>; 3], corners: &HashSet<Key>) -> Vec<[Key; 4]> {
        let mut tetrahedra = Vec::new();
        let centre = cell.centre();
        for axis in 0..3 {
            for side in [0, 1] {
                let mut way = [0; 3];
                way[axis] = 2 * side - 1;
                let place = cell.moved(way);
                let face = Face::new(cell, axis, side);
                if self.leaves.contains(&place) {
                    // The lower of the two does both.
                    if side == 0 {
                        continue;
                    }
                    let centres = [centre, place.centre()];
                    if walls[axis].contains(&face.corners[0][axis]) {
                        for [a, b, c] in face.triangles(corners) {
                            tetrahedra.extend(centres.map(|apex| [a, b, c, apex]));
                        }
                    } else {
                        tetrahedra.extend(
                            face.edges(corners).into_iter().map(|[a, b]| [a, b, centres[0], centres[1]]),
                        );
                    }
                } else if self.leaves.contains(&place.parent()) {
                    for [a, b, c] in face.halves() {
                        tetrahedra.extend([centre, place.parent().centre()].map(|apex| [a, b, c, apex]));
                    }
                } else if walls[axis].contains(&face.corners[0][axis])
                    && !Self::has_touching(&self.leaves, &place, way)
                {
                    tetrahedra.extend(face.triangles(corners).into_iter().map(|[a, b, c]| [a, b, c, centre]));
                }
            }
        }
        tetrahedra
    }
}

fn sorted(leaves: &HashSet<Cell>) -> Vec<Cell> {
    let mut all: Vec<Cell> = leaves.iter().copied().collect();
    all.par_sort_unstable();
    all
}

/// To the neighbours across faces and edges.
fn directions() -> impl Iterator<Item = Key> {
    (0..27)
        .map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
        .filter(|way| (1..=2).contains(&way.iter().filter(|x| **x != 0).count()))
}

/// A side of a cell.
struct Face {
    /// In order around.
    corners: [Key; 4],
    /// Which corner lies in the middle of the parent's face.
    middle: usize,
    centre: Key,
}

impl Face {
    fn new(cell: &Cell, axis: usize, side: i32) -> Self {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let size = cell.size();
        let corners = [[0, 0], [1, 0], [1, 1], [0, 1]].map(|[i, j]| {
            let mut corner = cell.at;
            corner[axis] += side * size;
            corner[u] += i * size;
            corner[v] += j * size;
            corner
        });
        let odd = |x: i32| (x / size) & 1 == 1;
        let middle = corners.iter().position(|c| odd(c[u]) && odd(c[v])).unwrap_or(0);
        let centre = std::array::from_fn(|a| (corners[0][a] + corners[2][a]) / 2);
        Face { corners, middle, centre }
    }

    /// Its edges, halved where a smaller cell's corner lies on them.
    fn edges(&self, corners: &HashSet<Key>) -> Vec<[Key; 2]> {
        let mut edges = Vec::with_capacity(8);
        for i in 0..4 {
            let (a, b) = (self.corners[i], self.corners[(i + 1) % 4]);
            let middle = std::array::from_fn(|x| (a[x] + b[x]) / 2);
            if corners.contains(&middle) {
                edges.extend([[a, middle], [middle, b]]);
            } else {
                edges.push([a, b]);
            }
        }
        edges
    }

    /// Two triangles that meet in the diagonal from the middle of the parent's face: both sides agree on it, also
    /// where the parent's neighbour is a leaf.
    fn halves(&self) -> [[Key; 3]; 2] {
        let [a, b, c, d] = std::array::from_fn(|i| self.corners[(self.middle + i) % 4]);
        [[a, b, c], [a, c, d]]
    }

    /// Halves, or a fan around the face's centre where its edges are halved.
    fn triangles(&self, corners: &HashSet<Key>) -> Vec<[Key; 3]> {
        let edges = self.edges(corners);
        if edges.len() == 4 {
            return self.halves().to_vec();
        }
        edges.into_iter().map(|[a, b]| [a, b, self.centre]).collect()
    }
}

/// Numbers the lattice points that the tetrahedra use, in ascending order.
pub(super) fn number(tetrahedra: &[[Key; 4]]) -> (Vec<Key>, Vec<[u32; 4]>) {
    let mut keys: Vec<Key> = tetrahedra.iter().flatten().copied().collect();
    keys.par_sort_unstable();
    keys.dedup();
    let index: HashMap<Key, u32> = keys.iter().enumerate().map(|(i, k)| (*k, i as u32)).collect();
    let numbered = tetrahedra.par_iter().map(|t| t.map(|k| index[&k])).collect();
    (keys, numbered)
}

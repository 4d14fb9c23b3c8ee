//! Which polygons the zero level set makes inside a cell, for each of the 256 sign patterns.
//!
//! Marching cubes (Lorensen and Cline, 1987) with its table derived instead of copied: on each face
//! of the cell the crossings of its edges are paired by a rule that looks at the signs of that face
//! alone, and following the pairs from face to face gives closed loops. Two cells that share a face
//! pair its crossings alike, so the mesh has no cracks. On a face with two negative corners across
//! the diagonal the negative side stays connected: a panel thinner than a cell stays whole.

/// The two corners of an edge: along `axis`, from the corner without that bit to the one with it.
/// Corner bits: 0 = x, 1 = y, 2 = z.
pub(super) const EDGES: [(u8, usize); 12] = {
    let mut edges = [(0, 0); 12];
    let mut i = 0;
    while i < 12 {
        let axis = i / 4;
        let low = ((i & 1) << ((axis + 1) % 3)) | ((i >> 1 & 1) << ((axis + 2) % 3));
        edges[i] = (low as u8, axis);
        i += 1;
    }
    edges
};

/// A loop of edge crossings, counter-clockwise as seen from the positive side.
pub(super) type Loop = Vec<u8>;

/// The loops of each sign pattern; bit `c` of the pattern is set where corner `c` is negative.
pub(super) struct CaseTable(Vec<Vec<Loop>>);

impl CaseTable {
    pub(super) fn new() -> Self {
        Self((0..=255).map(loops).collect())
    }

    /// The loops of `pattern`.
    pub(super) fn loops(&self, pattern: u8) -> &[Loop] {
        &self.0[usize::from(pattern)]
    }
}

/// Whether two edges of a cell lie on a common face.
pub(super) fn share_face(a: u8, b: u8) -> bool {
    let faces = |edge: u8| {
        let (low, axis) = EDGES[usize::from(edge)];
        (0..3).filter(move |&other| other != axis).map(move |other| (other, low >> other & 1))
    };
    faces(a).any(|face| faces(b).any(|other| other == face))
}

fn loops(pattern: u8) -> Vec<Loop> {
    let next = successors(pattern);
    let mut seen = [false; 12];
    let mut loops = Vec::new();
    for start in 0..12u8 {
        let mut polygon = Vec::new();
        let mut edge = start;
        while let (false, Some(following)) = (seen[usize::from(edge)], next[usize::from(edge)]) {
            seen[usize::from(edge)] = true;
            polygon.push(edge);
            edge = following;
        }
        if !polygon.is_empty() {
            loops.push(polygon);
        }
    }
    loops
}

/// For each crossed edge the next one around its loop.
fn successors(pattern: u8) -> [Option<u8>; 12] {
    let mut next = [None; 12];
    let negative = |corner: u8| pattern >> corner & 1 == 1;
    for axis in 0..3 {
        for side in 0..2u8 {
            let face = face_corners(axis, side);
            for i in 0..4 {
                let (from, to) = (face[i], face[(i + 1) % 4]);
                if !negative(from) || negative(to) {
                    continue;
                }
                // Here the walk leaves the negative side; it comes back behind the positive run.
                let back = (1..4)
                    .map(|k| (face[(i + k) % 4], face[(i + k + 1) % 4]))
                    .find(|&(from, to)| !negative(from) && negative(to));
                if let Some((last, first)) = back {
                    next[usize::from(edge_of(last, first))] = Some(edge_of(from, to));
                }
            }
        }
    }
    next
}

/// The corners of a face, counter-clockwise as seen from outside the cell.
fn face_corners(axis: usize, side: u8) -> [u8; 4] {
    let (b, c) = (1u8 << ((axis + 1) % 3), 1u8 << ((axis + 2) % 3));
    let base = side << axis;
    if side == 1 {
        [base, base | b, base | b | c, base | c]
    } else {
        [base, base | c, base | b | c, base | b]
    }
}

fn edge_of(a: u8, b: u8) -> u8 {
    let (low, axis) = (a & b, (a ^ b).trailing_zeros() as usize);
    let index = (low >> ((axis + 1) % 3) & 1) | (low >> ((axis + 2) % 3) & 1) << 1;
    axis as u8 * 4 + index
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_and_their_numbers_agree() {
        for (i, (low, axis)) in EDGES.into_iter().enumerate() {
            assert_eq!(usize::from(edge_of(low, low | 1 << axis)), i);
        }
    }

    #[test]
    fn every_crossed_edge_is_on_one_loop() {
        let table = CaseTable::new();
        for pattern in 0..=255u8 {
            let mut used = [0; 12];
            for polygon in table.loops(pattern) {
                assert!((3..=12).contains(&polygon.len()), "{pattern}: {polygon:?}");
                polygon.iter().for_each(|&e| used[usize::from(e)] += 1);
            }
            for (edge, (low, axis)) in EDGES.into_iter().enumerate() {
                let crossed = (pattern >> low ^ pattern >> (low | 1 << axis)) & 1;
                assert_eq!(used[edge], crossed, "pattern {pattern}, edge {edge}");
            }
        }
    }

    #[test]
    fn consecutive_crossings_share_a_face_and_some_fan_has_no_other_face_diagonal() {
        // A diagonal inside a face could be drawn by both of its cells, and the edge would then
        // have four triangles.
        let table = CaseTable::new();
        for pattern in 0..=255u8 {
            for polygon in table.loops(pattern) {
                let n = polygon.len();
                assert!((0..n).all(|i| share_face(polygon[i], polygon[(i + 1) % n])));
                let clean = (0..n).any(|apex| {
                    (2..n - 1).all(|k| !share_face(polygon[apex], polygon[(apex + k) % n]))
                });
                assert!(clean, "pattern {pattern}: {polygon:?}");
            }
        }
    }

    #[test]
    fn the_number_of_loops_is_that_of_marching_cubes() {
        let table = CaseTable::new();
        assert_eq!(table.loops(0).len() + table.loops(255).len(), 0);
        assert_eq!(table.loops(0b0000_0001).len(), 1);
        // Two negative corners across a face: connected, one loop of six.
        assert_eq!(table.loops(0b0000_1001).iter().map(Vec::len).collect::<Vec<_>>(), [6]);
        // Two positive ones: two triangles.
        assert_eq!(table.loops(!0b0000_1001).iter().map(Vec::len).collect::<Vec<_>>(), [3, 3]);
    }
}

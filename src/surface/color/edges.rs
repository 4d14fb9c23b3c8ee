//! Where the depth of a frame jumps, and how far every pixel near a jump is from it.

use crate::frame::DepthImage;

/// A jump is wider than this share of the depth.
const JUMP_SHARE: f32 = 0.03;
/// No return within so many pixels hides a jump.
const GAP: usize = 24;
/// Jumps farther away do not matter, pixels.
const REACH: f32 = 24.0;

/// A pixel on the other side of a jump.
#[derive(Debug, Clone, Copy)]
struct Across {
    u: u16,
    v: u16,
    /// The depth on the other side, m; 0 where there is no jump near.
    z: f32,
}

/// Column and row.
type Pixel = (usize, usize);

/// The last pixel with a return along a line.
#[derive(Debug, Clone, Copy)]
struct Return {
    at: Pixel,
    z: f32,
    /// The pixel after it, and how many came since.
    next: Pixel,
    gap: usize,
}

/// For every pixel the nearest one on the other side of a jump.
#[derive(Debug, Default)]
pub(super) struct Edges {
    width: usize,
    across: Vec<Across>,
}

fn jumps(a: f32, b: f32) -> bool {
    (a - b).abs() > JUMP_SHARE * a.min(b)
}

impl Edges {
    /// Finds the jumps of an image.
    pub(super) fn find(&mut self, depth: &DepthImage) {
        let height = depth.height as usize;
        self.width = depth.width as usize;
        self.across.clear();
        self.across.resize(self.width * height, Across { u: 0, v: 0, z: 0.0 });
        for v in 0..height {
            self.scan(depth, (0..self.width).map(|u| (u, v)));
        }
        for u in 0..self.width {
            self.scan(depth, (0..height).map(|v| (u, v)));
        }
        for v in 0..height {
            for u in 0..self.width {
                self.spread(depth, (u, v), [(u.wrapping_sub(1), v), (u, v.wrapping_sub(1))]);
            }
        }
        for v in (0..height).rev() {
            for u in (0..self.width).rev() {
                self.spread(depth, (u, v), [(u + 1, v), (u, v + 1)]);
            }
        }
    }

    /// Jumps along a line, which has pixels in order.
    fn scan(&mut self, depth: &DepthImage, line: impl Iterator<Item = Pixel>) {
        let mut last: Option<Return> = None;
        let mut before = (0, 0);
        for at in line {
            let z = depth.metres[at.1 * self.width + at.0];
            if let Some(last) = &mut last {
                last.next = if last.gap == 0 { at } else { last.next };
                last.gap += 1;
            }
            if z > 0.0 {
                if let Some(last) = last.filter(|last| last.gap <= GAP && jumps(z, last.z)) {
                    // What has no return is of what is behind: that begins beside what is before it.
                    let (front, beside, behind) =
                        if z < last.z { (at, before, last.at) } else { (last.at, last.next, at) };
                    self.offer(front, beside, z.max(last.z));
                    self.offer(behind, front, z.min(last.z));
                }
                last = Some(Return { at, z, next: at, gap: 0 });
            }
            before = at;
        }
    }

    fn offer(&mut self, at: Pixel, across: Pixel, z: f32) {
        let found = Across { u: across.0 as u16, v: across.1 as u16, z };
        let held = &mut self.across[at.1 * self.width + at.0];
        if held.z == 0.0 || square(at, found) < square(at, *held) {
            *held = found;
        }
    }

    /// What its neighbours know may hold for a pixel too.
    #[inline(always)]
    fn spread(&mut self, depth: &DepthImage, to: Pixel, from: [Pixel; 2]) {
        for (u, v) in from {
            if u >= self.width {
                continue;
            }
            let Some(&told) = self.across.get(v.wrapping_mul(self.width).wrapping_add(u)) else {
                continue;
            };
            if told.z == 0.0 || square(to, told) >= REACH * REACH {
                continue;
            }
            let z = depth.metres[to.1 * self.width + to.0];
            if z > 0.0 && jumps(z, told.z) {
                self.offer(to, (told.u.into(), told.v.into()), told.z);
            }
        }
    }

    /// How far a pixel is from the nearest jump, pixels, and the depth beyond, m.
    pub(super) fn at(&self, u: u32, v: u32) -> Option<(f32, f32)> {
        let at = (u as usize, v as usize);
        let found = self.across[at.1 * self.width + at.0];
        (found.z > 0.0).then(|| (square(at, found).sqrt() - 0.5, found.z))
    }
}

fn square((u, v): Pixel, to: Across) -> f32 {
    let (x, y) = (u as f32 - f32::from(to.u), v as f32 - f32::from(to.v));
    x * x + y * y
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One row of pixels.
    fn row(metres: &[f32]) -> (DepthImage, Edges) {
        let depth = DepthImage { width: metres.len() as u32, height: 1, metres: metres.to_vec() };
        let mut edges = Edges::default();
        edges.find(&depth);
        (depth, edges)
    }

    #[test]
    fn both_sides_of_a_jump_know_how_far_it_is_and_what_is_beyond() {
        let (_, edges) = row(&[1.0, 1.0, 1.0, 2.0, 2.0]);
        let found = [0, 1, 2, 3, 4].map(|u| edges.at(u, 0));
        let expected = [(2.5, 2.0), (1.5, 2.0), (0.5, 2.0), (0.5, 1.0), (1.5, 1.0)].map(Some);
        assert_eq!(found, expected);
    }

    #[test]
    fn what_has_no_return_belongs_to_what_is_behind() {
        let (_, edges) = row(&[2.0, 0.0, 0.0, 1.0, 1.0]);
        assert_eq!(edges.at(3, 0), Some((0.5, 2.0)), "the near thing ends where its returns end");
        assert_eq!(edges.at(0, 0), Some((2.5, 1.0)));
        assert_eq!(edges.at(1, 0), None);
        let mut wide = vec![0.0; GAP + 3];
        (wide[0], wide[GAP + 2]) = (1.0, 2.0);
        assert_eq!(row(&wide).1.at(0, 0), None, "too wide to be a shadow");
    }

    #[test]
    fn a_slope_is_no_jump_and_far_pixels_hear_of_none() {
        let slope: Vec<f32> = (0..50).map(|u| 1.0 + 0.02 * u as f32).collect();
        let (depth, edges) = row(&slope);
        assert!((0..depth.width).all(|u| edges.at(u, 0).is_none()));
        let step: Vec<f32> = (0..100).map(|u| if u < 50 { 1.0 } else { 2.0 }).collect();
        let (_, edges) = row(&step);
        assert!(edges.at(50 - REACH as u32 + 2, 0).is_some());
        assert!(edges.at(50 - REACH as u32 - 2, 0).is_none());
    }

    #[test]
    fn the_nearest_jump_counts_in_both_directions() {
        // A near square in the middle of a far plane.
        let near = |c: u32| (6..10).contains(&c);
        let metres = (0..16 * 16).map(|i| if near(i % 16) && near(i / 16) { 1.0 } else { 2.0 });
        let depth = DepthImage { width: 16, height: 16, metres: metres.collect() };
        let mut edges = Edges::default();
        edges.find(&depth);
        assert_eq!(edges.at(8, 3), Some((2.5, 1.0)), "above");
        assert_eq!(edges.at(8, 12), Some((2.5, 1.0)), "below");
        let (pixels, _) = edges.at(3, 2).expect("a corner is near");
        assert!((pixels - (5.0 - 0.5)).abs() < 0.3, "{pixels}");
    }
}

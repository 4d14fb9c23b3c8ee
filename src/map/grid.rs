//! Boxes of voxels: where their centres are, and where they stand in a column.

use std::ops::Range;

use glam::{UVec3, Vec3};

use crate::geometry::Aabb;

/// Voxels that begin at a low corner, x the fastest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GridShape {
    /// Low corner of the low voxel, world metres.
    pub origin: Vec3,
    pub voxel_m: f32,
    /// Voxels along x, y, z.
    pub size: UVec3,
}

impl GridShape {
    /// As many voxels as cover `region`, at least one along each axis.
    pub fn covering(region: &Aabb, voxel_m: f32) -> Self {
        /// A voxel that would be filled less than this is left out: rounding.
        const LEAST_SHARE: f32 = 1e-3;
        let size = (region.size() / voxel_m - LEAST_SHARE).ceil().max(Vec3::ONE);
        Self { origin: region.min, voxel_m, size: size.as_uvec3() }
    }

    /// The number of voxels.
    pub fn voxels(&self) -> u64 {
        let [x, y, z] = self.size.to_array().map(u64::from);
        x.saturating_mul(y).saturating_mul(z)
    }

    /// How far apart neighbours along x, y and z stand in a column.
    pub fn stride(&self) -> UVec3 {
        UVec3::new(1, self.size.x, self.size.x * self.size.y)
    }

    /// The centre of the voxel with coordinates `at`, world metres.
    pub fn center(&self, at: UVec3) -> Vec3 {
        self.origin + (at.as_vec3() + 0.5) * self.voxel_m
    }

    /// The centre of the voxel at a place of a column.
    pub fn center_at(&self, index: usize) -> Vec3 {
        let (x, rest) = (index as u32 % self.size.x, index as u32 / self.size.x);
        self.center(UVec3::new(x, rest % self.size.y, rest / self.size.y))
    }
}

impl GridShape {
    /// Centres of voxels along an axis, world metres.
    pub fn centers_along(&self, axis: usize, voxels: Range<u32>) -> Vec<f32> {
        voxels.map(|at| self.origin[axis] + (at as f32 + 0.5) * self.voxel_m).collect()
    }
}

/// A box of voxels in pieces that follow each other in a column: whole layers, or whole rows of one,
/// or parts of a row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pieces {
    size: UVec3,
    piece: UVec3,
}

impl Pieces {
    /// Of at most `most` voxels each, which is not 0.
    pub fn new(size: UVec3, most: u32) -> Self {
        let x = size.x.min(most);
        let y = if x < size.x { 1 } else { size.y.min(most / x.max(1)) };
        let z = if y < size.y { 1 } else { size.z.min(most / (x * y).max(1)) };
        Self { size, piece: UVec3::new(x, y, z).max(UVec3::ONE) }
    }

    fn along(&self) -> UVec3 {
        (self.size + (self.piece - 1)) / self.piece
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.along().to_array().into_iter().map(|n| n as usize).product()
    }

    /// The voxels of a piece along x, y and z.
    pub fn voxels(&self, index: usize) -> [Range<u32>; 3] {
        let (along, index) = (self.along(), index as u32);
        let at = UVec3::new(index % along.x, index / along.x % along.y, index / along.x / along.y);
        let (low, high) = (at * self.piece, ((at + 1) * self.piece).min(self.size));
        [low.x..high.x, low.y..high.y, low.z..high.z]
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn pieces_follow_each_other_and_are_not_too_large(
            size in prop::array::uniform3(1u32..20), most in 1u32..200,
        ) {
            let shape = GridShape { origin: Vec3::ZERO, voxel_m: 0.1, size: UVec3::from(size) };
            let pieces = Pieces::new(shape.size, most);
            let mut next = 0;
            for index in 0..pieces.count() {
                let [x, y, z] = pieces.voxels(index);
                prop_assert!(x.len() * y.len() * z.len() <= most as usize);
                for (z, y) in z.flat_map(|z| y.clone().map(move |y| (z, y))) {
                    for x in x.clone() {
                        let at = UVec3::new(x, y, z);
                        prop_assert_eq!(at.dot(shape.stride()), next);
                        next += 1;
                        let center = shape.center(at);
                        prop_assert_eq!(shape.centers_along(1, y..y + 1), [center.y]);
                    }
                }
            }
            prop_assert_eq!(u64::from(next), shape.voxels());
        }
    }

    #[test]
    fn voxels_cover_their_region_and_x_is_the_fastest() {
        let region = Aabb { min: Vec3::new(-1.0, 0.0, 2.0), max: Vec3::new(-0.7, 0.25, 2.0) };
        let grid = GridShape::covering(&region, 0.1);
        assert_eq!((grid.size, grid.stride()), (UVec3::new(3, 3, 1), UVec3::new(1, 3, 9)));
        assert_eq!(grid.voxels(), 9);
        let index = UVec3::new(2, 1, 0).dot(grid.stride()) as usize;
        assert_eq!(grid.center_at(index), grid.center(UVec3::new(2, 1, 0)));
        assert!((grid.center_at(5) - Vec3::new(-0.75, 0.15, 2.05)).length() < 1e-6);
    }
}

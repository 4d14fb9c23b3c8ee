//! Boxes of voxels: where their centres are, and where they stand in a column.

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

#[cfg(test)]
mod tests {
    use super::*;

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

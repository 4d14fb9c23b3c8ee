//! Random trees with holes and with voxels that carry no rows, for property tests.

use proptest::prelude::*;

use super::lookup::{ChildLink, NodeSource, Root};

/// The root spans 2^this units around the origin.
pub(super) const LOG2_SIZE: u8 = 4;
pub(super) const UNIT_M: f32 = 0.5;

/// A voxel as one would draw it.
#[derive(Debug, Clone, Default)]
pub(super) struct Voxel {
    pub(super) has_rows: bool,
    pub(super) children: [Option<Box<Self>>; 8],
}

pub(super) fn voxels() -> impl Strategy<Value = Voxel> {
    let leaf = any::<bool>().prop_map(|has_rows| Voxel { has_rows, ..Voxel::default() });
    leaf.prop_recursive(LOG2_SIZE.into(), 256, 8, |child| {
        let children = prop::array::uniform8(prop::option::of(child.prop_map(Box::new)));
        (any::<bool>(), children).prop_map(|(has_rows, children)| Voxel { has_rows, children })
    })
}

/// The voxels in flat arrays. A hole has rows, so that it shows where a descent ends in one.
pub(super) struct Flat {
    children: Vec<ChildLink>,
    corners: Vec<[u32; 8]>,
}

impl Flat {
    pub(super) fn new(root: &Voxel) -> Self {
        let mut flat = Self { children: vec![0; 8], corners: vec![[0; 8]; 8] };
        flat.lay(root, 0);
        flat
    }

    fn lay(&mut self, voxel: &Voxel, node: usize) {
        self.corners[node] = [if voxel.has_rows { node as u32 } else { u32::MAX }; 8];
        let first = self.children.len();
        let exists = |(octant, child): (usize, &Option<_>)| u32::from(child.is_some()) << octant;
        let mask: u32 = voxel.children.iter().enumerate().map(exists).sum();
        if mask == 0 {
            return;
        }
        self.children[node] = (first as u32 / 8) << 8 | mask;
        self.children.resize(first + 8, 0);
        self.corners.resize(first + 8, [0; 8]);
        for (octant, child) in voxel.children.iter().enumerate() {
            if let Some(child) = child {
                self.lay(child, first + octant);
            }
        }
    }
}

impl NodeSource for Flat {
    fn root(&self) -> Option<Root> {
        Some(Root { node: 0, min: [-(1 << (LOG2_SIZE - 1)); 3], log2_size: LOG2_SIZE })
    }

    fn unit_m(&self) -> f32 {
        UNIT_M
    }

    fn children(&self, node: u32) -> ChildLink {
        self.children[node as usize]
    }

    fn corners(&self, node: u32) -> &[u32; 8] {
        &self.corners[node as usize]
    }
}

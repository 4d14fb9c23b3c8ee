//! Slots as bytes.

use bytemuck::{Pod, Zeroable};

use crate::map::view::Node;
use crate::octree::{Cell, ChildLink, Uppers};

/// A node as it is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct NodeSlot {
    pub children: ChildLink,
    pub corners: [u32; 8],
    pub brick: u32,
    pub block: u32,
    pub code_block: u32,
    pub low: Cell,
    pub log2_size: u32,
}

impl NodeSlot {
    pub(super) fn new(children: ChildLink, node: &Node) -> Self {
        let Node { corners, brick, block, code_block, low, log2_size } = *node;
        Self { children, corners, brick, block, code_block, low, log2_size: log2_size.into() }
    }
}

/// Where a block is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct BlockSlot {
    pub cell: Cell,
    pub uppers: Uppers,
}

pub(super) const BLOCK_BYTES: usize = size_of::<BlockSlot>();

//! Tree exchange: kd-trees out of a scene, and into one.
use std::mem::{align_of, size_of};

use crate::callback::call;
use crate::{sys, Result, Scene};

/// A node of a [`KdTree`], as the library stores it. [`kind`](KdTreeNode::kind) decodes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[repr(C)]
pub struct KdTreeNode {
    /// Inner: the bits of the float plane. Leaf: the first reference.
    pub word: u32,
    /// Inner: child << 2 | axis. Leaf: count << 2 | 3.
    pub tag: u32,
}

const _: () = assert!(size_of::<KdTreeNode>() == size_of::<sys::gpurt_kdtree_node>());
const _: () = assert!(align_of::<KdTreeNode>() == align_of::<sys::gpurt_kdtree_node>());

/// What a [`KdTreeNode`] says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum KdTreeNodeKind {
    /// Splits its cell.
    Inner {
        /// 0, 1, 2: X, Y, Z.
        axis: u32,
        /// Where on the axis.
        plane: f32,
        /// The node below the plane; the one above is the next.
        child: u32,
    },
    /// Holds triangles.
    Leaf {
        /// The first of its references.
        first: u32,
        /// How many there are.
        count: u32,
    },
}

impl KdTreeNode {
    /// Decodes the node.
    pub fn kind(self) -> KdTreeNodeKind {
        match self.tag & 3 {
            3 => KdTreeNodeKind::Leaf { first: self.word, count: self.tag >> 2 },
            axis => KdTreeNodeKind::Inner { axis, plane: f32::from_bits(self.word), child: self.tag >> 2 },
        }
    }
}

impl From<KdTreeNodeKind> for KdTreeNode {
    fn from(kind: KdTreeNodeKind) -> Self {
        match kind {
            KdTreeNodeKind::Inner { axis, plane, child } => {
                KdTreeNode { word: plane.to_bits(), tag: child << 2 | axis }
            }
            KdTreeNodeKind::Leaf { first, count } => KdTreeNode { word: first, tag: count << 2 | 3 },
        }
    }
}

/// A kd-tree of a scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct KdTree {
    /// 0: of all geometries placed once, in world space; 1 + g: of geometry g, in object space.
    pub tree: u32,
    /// Triangles of this tree; tree 0 orders them by instance, then primitive.
    pub num_triangles: u64,
    /// The root's cell.
    pub bounds_min: [f32; 3],
    /// The root's cell.
    pub bounds_max: [f32; 3],
    /// Node 0 is the root; a child's index exceeds its parent's.
    pub nodes: Vec<KdTreeNode>,
    /// Triangles of leaves.
    pub references: Vec<u32>,
}

impl Scene {
    /// Copies a kd-tree of the last commit out: 0, all geometries placed once; 1 + g, geometry g.
    pub fn export_tree(&self, tree: u32) -> Result<KdTree> {
        let mut raw = sys::gpurt_kdtree { tree, ..Default::default() };
        // SAFETY: the handle is valid; without arrays, sizes and bounds alone are written.
        call(|| unsafe { sys::gpurt_scene_export_tree(self.as_raw(), &mut raw) })?;
        let mut nodes = vec![KdTreeNode::default(); raw.num_nodes as usize];
        let mut references = vec![0; raw.num_references as usize];
        raw.nodes = nodes.as_mut_ptr() as *mut sys::gpurt_kdtree_node;
        raw.references = references.as_mut_ptr();
        // SAFETY: the arrays have as many elements as the sizes say; KdTreeNode has the layout of the ABI's.
        call(|| unsafe { sys::gpurt_scene_export_tree(self.as_raw(), &mut raw) })?;
        // A commit of another thread in between may have made a smaller tree.
        nodes.truncate(raw.num_nodes as usize);
        references.truncate(raw.num_references as usize);
        Ok(KdTree {
            tree: raw.tree,
            num_triangles: raw.num_triangles,
            bounds_min: raw.bounds_min,
            bounds_max: raw.bounds_max,
            nodes,
            references,
        })
    }

    /// Hands in a kd-tree that the next commits use in place of building one, until the geometry changes.
    ///
    /// Every triangle must be in the leaves that it touches, else hits are lost: that alone is not checked.
    pub fn import_tree(&self, tree: &KdTree) -> Result<()> {
        let raw = sys::gpurt_kdtree {
            tree: tree.tree,
            num_nodes: tree.nodes.len() as u64,
            num_references: tree.references.len() as u64,
            num_triangles: tree.num_triangles,
            bounds_min: tree.bounds_min,
            bounds_max: tree.bounds_max,
            nodes: tree.nodes.as_ptr() as *mut sys::gpurt_kdtree_node, // read alone
            references: tree.references.as_ptr() as *mut u32,
            ..Default::default()
        };
        // SAFETY: the handle is valid; the arrays live during the call, which copies them.
        call(|| unsafe { sys::gpurt_scene_import_tree(self.as_raw(), &raw) })
    }
}

//! Builds the wedges of a cluster: all corners of a vertex with the same material and texture coordinate are one wedge.
//!
//! # Memory
//! 4 bytes per vertex and per texcoord, 8 per wedge; and 4 bytes per wedge that stay, its texcoord.

use std::collections::HashMap;

use glam::DVec2;

use super::id::ClusterTexcoord;
use crate::base::id::{TiSlice, TiVec};
use crate::mesh::ClusterMesh;
use crate::mesh::id::{LocalVertex, Wedge};
use crate::model::id::MaterialId;

/// Wedges of a vertex that are searched linearly; further ones are in a hash map.
const CHAIN_MAX: usize = 32;

/// What tells a wedge from others.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
struct WedgeKey {
    vertex: LocalVertex,
    material: MaterialId,
    /// Bits of the scaled texture coordinate.
    uv: [u64; 2],
}

/// A wedge in the chain of its vertex.
#[derive(Debug, Clone, Copy)]
struct ChainedWedge {
    /// The next wedge of the vertex, or none.
    next: Wedge,
    material: MaterialId,
}

/// Builds the wedges of a mesh whose vertices are there.
pub(super) struct WedgeBuilder<'a> {
    mesh: &'a mut ClusterMesh,
    texcoords: &'a TiSlice<ClusterTexcoord, DVec2>,
    /// Texture coordinate of each wedge, or none.
    pub texcoord_of: TiVec<Wedge, ClusterTexcoord>,
    /// The first wedge of each vertex, or none.
    first: TiVec<LocalVertex, Wedge>,
    chained: TiVec<Wedge, ChainedWedge>,
    /// The last wedge that used each texture coordinate, which is usually the one wanted next.
    recent: TiVec<ClusterTexcoord, Wedge>,
    /// Wedges of a vertex beyond the first [`CHAIN_MAX`]; only looked up, never iterated.
    crowd: HashMap<WedgeKey, Wedge>,
}

impl<'a> WedgeBuilder<'a> {
    pub fn new(mesh: &'a mut ClusterMesh, texcoords: &'a TiSlice<ClusterTexcoord, DVec2>) -> Self {
        let vertex_count = mesh.positions.len();
        // An ordinary mesh has a wedge for each texture coordinate.
        let wedge_count = texcoords.len().clamp(vertex_count + vertex_count / 4, 2 * vertex_count);
        mesh.wedge_vertex.reserve(wedge_count);
        mesh.wedge_uv.reserve(wedge_count);
        let first = mesh.per_vertex(Wedge::NONE);
        Self {
            mesh,
            texcoords,
            texcoord_of: TiVec::with_capacity(wedge_count),
            first,
            chained: TiVec::with_capacity(wedge_count),
            recent: vec![Wedge::NONE; texcoords.len()].into(),
            crowd: HashMap::new(),
        }
    }

    /// The wedge of a corner, by its vertex, texture coordinate (or none) and material; `scale` is that of the latter.
    #[inline]
    pub fn wedge(&mut self, vertex: LocalVertex, texcoord: ClusterTexcoord, material: MaterialId, scale: f64) -> Wedge {
        let recent = self.recent.get(texcoord).and_then(|recent| recent.some());
        if let Some(wedge) = recent
            && self.mesh.wedge_vertex[wedge] == vertex
            && self.chained[wedge].material == material
        {
            return wedge;
        }
        let uv = self.texcoords.get(texcoord).map_or(DVec2::NAN, |&uv| uv * scale);
        let key = WedgeKey { vertex, material, uv: uv.to_array().map(f64::to_bits) };
        let (mut wedge, mut walked) = (self.first[vertex], 0);
        while wedge != Wedge::NONE && !self.fits(wedge, &key) {
            wedge = self.chained[wedge].next;
            walked += 1;
        }
        if wedge == Wedge::NONE && walked == CHAIN_MAX {
            wedge = self.crowd.get(&key).copied().unwrap_or(Wedge::NONE);
        }
        if wedge == Wedge::NONE {
            wedge = self.mesh.push_wedge(vertex, uv);
            self.chained.push(ChainedWedge { next: self.first[vertex], material });
            self.texcoord_of.push(texcoord);
            match walked {
                CHAIN_MAX => _ = self.crowd.insert(key, wedge),
                _ => self.first[vertex] = wedge,
            }
        }
        if let Some(recent) = self.recent.get_mut(texcoord) {
            *recent = wedge;
        }
        wedge
    }

    /// Reports whether a wedge of the vertex of the key has its material and texture coordinate.
    #[inline]
    fn fits(&self, wedge: Wedge, key: &WedgeKey) -> bool {
        self.chained[wedge].material == key.material && self.mesh.wedge_uv[wedge].to_array().map(f64::to_bits) == key.uv
    }
}

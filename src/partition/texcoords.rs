//! Copies texture coordinates to the clusters, if those of a cluster are scattered over the file.
//!
//! ```text
//! each cluster  ids that its faces refer to, ascending      ──▶ questions, by window of ids
//! each window   its texture coordinates, its questions       ──▶ answers, by cluster, in the order of the ids
//! ```
//! Every file is read and written sequentially. If the file is in the order of an exporter, each cluster reads its few
//! stretches from the mesh instead, which is faster and has the same result.
//!
//! # Memory
//! The ids of a cluster in each thread, one window ([`window_bytes`], as for the ranks of vertices), and 24 MiB of
//! buffers.
//!
//! # Files
//! `<name>-questions.buckets` (2 to 4 bytes per id of each cluster) until they are answered,
//! `<name>-texcoords.buckets` (5 bytes each) until the partition is removed.

use std::ops::Range;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::faces::ClusteredFaces;
use super::file_names::FileNames;
use super::id::{ClusterId, ClusterTexcoord, WindowId};
use super::numbering::window_bytes;
use super::options::PartitionOptions;
use super::texcoord_ids::texcoord_ids;
use crate::base::Result;
use crate::base::id::{IdWindow, TiVec};
use crate::base::ordered::map_in_order;
use crate::file::buckets::{BucketWriter, Buckets};
use crate::file::record::{Record, decode_pairs, encode_pairs};
use crate::model::StoredMesh;
use crate::model::id::Texcoord;

/// Bytes of a texture coordinate.
const TEXCOORD_BYTES: u64 = 16;
/// Texture coordinates decoded at once.
const STEP: u64 = 1 << 16;

/// Texture coordinates of each cluster, in order of their ids.
#[derive(Debug, Serialize, Deserialize)]
pub struct ClusteredTexcoords {
    pub(super) answers: Buckets<DVec2, ClusterId>,
}

impl ClusteredTexcoords {
    /// Returns the texture coordinates of a cluster.
    ///
    /// # Errors
    /// On failed reads.
    pub fn read(&self, cluster: ClusterId) -> Result<TiVec<ClusterTexcoord, DVec2>> {
        self.answers.to_vec(1, cluster).map(TiVec::from)
    }
}

/// A texture coordinate that a cluster needs.
#[derive(Debug, Clone, Copy)]
struct TexcoordQuestion {
    cluster: ClusterId,
    texcoord: Texcoord,
}

impl Record for TexcoordQuestion {
    fn encode(records: &[Self], out: &mut Vec<u8>) {
        encode_pairs(records.iter().map(|question| [question.cluster.number(), question.texcoord.number()]), out);
    }

    fn decode(bytes: &[u8], count: usize, out: &mut Vec<Self>) -> std::result::Result<(), String> {
        decode_pairs(bytes, count, |[cluster, texcoord]| {
            out.push(Self { cluster: ClusterId::new(cluster), texcoord: Texcoord::new(texcoord) });
        })
    }
}

/// Copies the texture coordinates to the clusters.
///
/// # Errors
/// On a full disk, failed reads and writes.
pub(super) fn bring(
    mesh: &StoredMesh,
    faces: &ClusteredFaces,
    names: FileNames<'_>,
    options: &PartitionOptions,
) -> Result<ClusteredTexcoords> {
    let cluster_count = faces.by_cluster.cell_count();
    let count = mesh.texcoord_count();
    let window_len = (window_bytes(options.work_bytes) / TEXCOORD_BYTES).max(1 << 16) as u32;
    let windows = count.div_ceil(u64::from(window_len)).max(1) as usize;
    let mut questions = BucketWriter::<TexcoordQuestion, WindowId>::create(&names.path("questions.buckets"), windows)?;
    map_in_order(
        ClusterId::first(cluster_count),
        options.threads,
        options.threads + 1,
        |cluster| Ok((cluster, texcoord_ids(&faces.by_cluster.to_vec(1, cluster)?))),
        |(cluster, ids)| {
            let question = |texcoord| TexcoordQuestion { cluster, texcoord };
            ids.into_iter().try_for_each(|id| questions.push(WindowId::new(id.number() / window_len), question(id)))
        },
    )?;
    let questions = questions.finish()?;
    let mut answers = BucketWriter::create(&names.path("texcoords.buckets"), cluster_count)?;
    for window in WindowId::first(windows) {
        let start = window.number() * window_len;
        let texcoords = texcoords_in(mesh, u64::from(start)..(u64::from(start) + u64::from(window_len)).min(count))?;
        let texcoords = IdWindow::new(Texcoord::new(start), texcoords);
        questions.read(window, |questions| {
            questions.iter().try_for_each(|question| answers.push(question.cluster, texcoords[question.texcoord]))
        })?;
    }
    Ok(ClusteredTexcoords { answers: answers.finish_durable()? })
}

/// Returns the texture coordinates of a range of ids.
fn texcoords_in(mesh: &StoredMesh, ids: Range<u64>) -> Result<Vec<DVec2>> {
    let mut texcoords = Vec::with_capacity((ids.end - ids.start) as usize);
    let mut base = 0;
    for piece in &mesh.pieces {
        let end = base + piece.texcoords.len();
        let (mut at, last) = (ids.start.max(base), ids.end.min(end));
        while at < last {
            let next = (at + STEP).min(last);
            texcoords.append(&mut piece.texcoords.window(at - base..next - base)?);
            at = next;
        }
        base = end;
    }
    Ok(texcoords)
}

//! How the result is written.

use super::targets::Sources;

/// How texture images get to the result.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Textures {
    /// Copied to `<stem>_textures/` beside the output.
    #[default]
    Copy,
    /// Linked into that folder: as a symbolic link, else as a hard link, else copied.
    Link,
    /// Left in place; the MTL refers to them by a path relative to the output's folder.
    Reference,
}

/// Options of writing the result.
#[derive(Debug, Clone)]
pub struct WriteOptions {
    /// How texture images get to the result.
    pub textures: Textures,
    /// Whether texture images outside of the MTL's folder are copied or linked, too.
    pub brings_outside: bool,
    /// Whether vertex normals are computed and written.
    pub normals: bool,
    /// Whether a GLB is turned, so that what was z points up along its y.
    pub turns_z_up: bool,
    /// Whether an existing result may be replaced.
    pub force: bool,
    /// Whether an existing mesh file was written by this job; it may then always be replaced.
    pub replaces_own: bool,
    /// Memory for this phase in bytes; below 32 MiB it uses somewhat more.
    pub work_bytes: u64,
    /// Files that must not be replaced.
    pub sources: Sources,
    /// Id of the job, which marks its temporary files.
    pub job: u64,
}

impl WriteOptions {
    /// Reports whether an existing mesh file may be replaced.
    pub(super) fn may_replace_mesh(&self) -> bool {
        self.force || self.replaces_own
    }
}

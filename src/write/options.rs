//! How the result is written.

use super::targets::Sources;

/// What becomes of the images that materials refer to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Textures {
    /// Copied into `<stem>_textures/` beside the output.
    #[default]
    Copy,
    /// Linked there: a symbolic link, else a hard link, else a copy.
    Link,
    /// Left where they are; the MTL names the path to them from the output's folder.
    Reference,
}

/// How the result is written.
#[derive(Debug, Clone)]
pub struct WriteOptions {
    /// What becomes of the textures.
    pub textures: Textures,
    /// Whether those outside of the MTL's folder are copied or linked like the others.
    pub brings_outside: bool,
    /// Whether vertex normals are computed and written.
    pub normals: bool,
    /// Whether an older result may be replaced.
    pub force: bool,
    /// Whether the OBJ that is there is this job's own, which may be replaced in any case.
    pub replaces_own: bool,
    /// Memory that the phase may use, in bytes; below 32 MiB it uses somewhat more.
    pub work_bytes: u64,
    /// Files that must not be replaced.
    pub sources: Sources,
    /// Number of the job, by which files that wait for their names are its own.
    pub job: u64,
}

impl WriteOptions {
    /// Whether an OBJ that is there may be replaced.
    pub(super) fn may_replace_obj(&self) -> bool {
        self.force || self.replaces_own
    }
}

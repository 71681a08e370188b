//! Choices among a few ways, each with its name and a sentence; the command line and the reports use the same.

use serde::{Deserialize, Serialize};

/// A choice among a few ways.
pub trait Choice: Copy + 'static {
    /// All ways, in the order in which they are listed.
    const ALL: &'static [Self];
    /// Name of the way, as options and reports spell it.
    fn name(self) -> &'static str;
    /// What the way does, in a sentence without a full stop.
    fn help(self) -> &'static str;
}

/// Defines a choice: an enum whose variants have a name, and a doc comment that is also the help of the variant.
macro_rules! choice {
    (
        $(#[doc = $about:literal])+
        $type:ident {
            $($(#[doc = $help:literal])+ $variant:ident = $name:literal,)+
        }
    ) => {
        $(#[doc = $about])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
        pub enum $type {
            $($(#[doc = $help])+ #[serde(rename = $name)] $variant,)+
        }

        impl Choice for $type {
            const ALL: &'static [Self] = &[$(Self::$variant),+];

            fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $name,)+
                }
            }

            fn help(self) -> &'static str {
                match self {
                    $(Self::$variant => concat!($($help),+).trim_start(),)+
                }
            }
        }
    };
}

choice! {
    /// How texture seams are simplified.
    Seams {
        /// Lock seams in the first of several passes, but not if --max-error ends it; then collapse them along their own line
        Stitch = "stitch",
        /// Collapse seams along their own line in every pass
        Follow = "follow",
        /// Keep every seam vertex where it is
        Lock = "lock",
    }
}

choice! {
    /// How open borders are simplified.
    Borders {
        /// Collapse borders along their own line
        Simplify = "simplify",
        /// Keep every border vertex where it is
        Lock = "lock",
    }
}

choice! {
    /// Whether vertices at the same position are merged.
    Weld {
        /// Merge vertices whose positions are identical to the bit
        Exact = "exact",
        /// Merge nothing
        Off = "off",
    }
}

choice! {
    /// Whether the topology may change.
    Topology {
        /// Holes close, components vanish, non-manifold vertices collapse if that costs no more than other collapses
        Simplify = "simplify",
        /// No hole closes, no component vanishes, non-manifold vertices stay where they are
        Keep = "keep",
    }
}

choice! {
    /// What happens to connected components that are smaller than the error.
    Pieces {
        /// Drop none for its size alone; --topology simplify may still remove or join some
        Keep = "keep",
        /// Remove components whose bounding-box diagonal is smaller than the present error, the smallest first, until
        /// the target is met; not with --max-error
        Drop = "drop",
    }
}

choice! {
    /// What happens to faces that lie on each other.
    Doubles {
        /// Keep all; with --topology keep their vertices are locked
        Keep = "keep",
        /// Keep the first of the faces that have the same three vertices, whichever way they face
        Drop = "drop",
    }
}

choice! {
    /// The cost of a collapse.
    MetricChoice {
        /// Distance to the surface
        Qem = "qem",
        /// Distance to the surface, and texture drift
        QemAttributes = "qem-attributes",
        /// Distance to planes of equal weight; open borders erode (Garland & Heckbert 1997, the papers' baseline)
        Qem1997 = "qem-1997",
        /// Oblique photogrammetry: thins rough ground first; corners of seams stay where they are (Wang et al. 2024)
        Oblique = "oblique",
        /// Keeps thin and bent parts longer than flat ones (Quan et al. 2015)
        Curvature = "curvature",
        /// Terrain: position, texture and normal; keeps open borders edge for edge (Li, Shi & Zhu 2018)
        Terrain = "terrain",
        /// Keeps sharp and richly textured parts longest, and open borders (Li, Jiang & Tang 2020)
        Sharpness = "sharpness",
    }
}

choice! {
    /// How normals are written.
    Normals {
        /// Recompute normals (60° crease) if the input has any
        Auto = "auto",
        /// Write no normals
        Drop = "drop",
    }
}

choice! {
    /// Which axis of the mesh points up; in a GLB that is y.
    UpAxis {
        /// As in surveys: a GLB is turned, so that y is up
        Z = "z",
        /// Axes stay as they are
        Y = "y",
    }
}

choice! {
    /// How vertices and triangles of tiles are stored.
    TileCompression {
        /// As EXT_meshopt_compression of glTF: without loss, for viewers that have its decoder
        Meshopt = "meshopt",
        /// As they are, for every viewer of glTF
        None = "none",
    }
}

choice! {
    /// How texture images reach the output.
    TextureFiles {
        /// Copy them beside the output
        Copy = "copy",
        /// Link to them beside the output
        Link = "link",
        /// Leave them; the MTL names their paths
        Reference = "reference",
        /// Bake new ones: seams no longer hold the mesh, and each texel shows the colour of the input there
        Bake = "bake",
    }
}

choice! {
    /// How texture images outside of the folder of their MTL reach the output.
    TexturesOutside {
        /// Leave them: an MTL names their paths; new textures, GLB files and tiles do not show them
        Refer = "refer",
        /// Copy, link or read them as the others; for input that you trust
        Copy = "copy",
    }
}

choice! {
    /// What to do with an unfinished job in the work folder.
    ResumeChoice {
        /// Resume it if the input and options match, otherwise stop with exit code 5
        Auto = "auto",
        /// Resume it; fail if it is missing, different or damaged
        Require = "require",
        /// Delete it and start over
        Never = "never",
    }
}

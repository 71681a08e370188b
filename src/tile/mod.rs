//! From a mesh to a pyramid of tiles that a browser streams.
//!
//! ```text
//! input ── chain: passes, each measured ──▶ levels: whole meshes, each within a texel of its own from the input
//!   │                                          │
//!   ╰─ tree: nested planes ── node_counts: which nodes are the tiles of a level
//!                                              │
//!                                cut ── skirt, paint, glb ──▶ a file for each tile ── tileset.json, last
//! ```
//! In: the surface of the input, its images, and a mesh that passes begin with. Out: a folder with a tileset and its tiles.
//! Invariant: two tiles of a level have the same corners and edges where they meet, to the bit. The bytes depend on the
//! input and the options alone. A tile is done or not: after a kill, the tiles that are done are recalled.
//!
//! # Memory
//! For each thread a tile: its triangles (700 bytes each), its image (8 bytes a texel), and a painter (16 MiB).

mod node_counts;
mod chain;
mod check;
mod clip;
mod copy;
mod colours;
mod crew;
mod cut;
mod deviation;
mod figures;
mod glb;
mod lattice;
pub mod lend;
mod mesh;
mod meshopt;
mod one_image;
mod paint;
mod raw;
mod run;
mod scene;
mod settings;
mod skirt;
mod steps;
mod tileset;
mod tree;
mod triangles;

pub use self::chain::{Chain, Level, PassMesh, last_faces, pass_count};
pub use self::check::{LevelCheck, TilesetCheck, TilesetInput, check_tileset, check_tileset_against};
pub use self::crew::TileCrew;
pub use self::figures::LevelFigures;
pub use self::run::Pyramid;
pub use self::scene::{EdgeLengths, TileScene};
pub use self::settings::{TilePlace, TileSettings, tile_limits};
pub use self::steps::TileStep;
pub use self::tileset::TILESET;

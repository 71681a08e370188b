//! The tests of whole runs, and of how the project reads, in one program: they build in half the time of one program each.

#[path = "../meshes/mod.rs"]
mod meshes;
mod source;
mod words;

mod bake;
mod bake_onto;
mod borders_and_seams;
mod build_id;
mod compare;
mod constants;
mod determinism;
mod docs;
mod end_to_end;
mod examples;
mod gauge;
mod glb;
mod glb_reader;
mod hands;
mod house;
mod in_memory;
mod inputs;
mod layering;
mod many_clusters;
mod options_doc;
mod places;
mod ply;
mod polygons;
mod properties;
mod real_tiles;
mod remesh;
mod results;
mod summary;
mod targets;
mod tile;
mod tile_damage;
mod tile_errors;
mod tile_extremes;
mod tile_sizes;
mod tile_views;
mod topology;

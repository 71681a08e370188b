//! Texture images: which files materials show, and their pixels, decoded in bounded memory.

pub mod decode;
pub mod encode;
mod jpeg_scan;
#[cfg(feature = "ktx2")]
mod ktx2;
pub mod sound;
pub mod stored;
pub mod textures;

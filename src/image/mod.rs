//! Texture images: which files materials show, and their pixels, decoded in bounded memory.

pub mod decode;
pub mod encode;
#[cfg(feature = "ktx2")]
mod ktx2;
pub mod stored;
pub mod textures;

//! Texture images: which files materials show, and their pixels, decoded in bounded memory.

pub mod decode;
pub mod encode;
pub mod stored;
pub mod textures;

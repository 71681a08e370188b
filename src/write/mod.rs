//! A stored mesh becomes one OBJ with its MTL and textures.

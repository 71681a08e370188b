//! What a mesh is like: cracks, topology, folded texture triangles.

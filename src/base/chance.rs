//! Pseudorandom numbers that are the same in every run.

/// Increment of the state of SplitMix64.
pub const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

/// One step of SplitMix64 and its finaliser (Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number
/// Generators").
pub fn mixed(state: u64) -> u64 {
    let mut z = state.wrapping_add(INCREMENT);
    z = (z ^ z >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ z >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ z >> 31
}

/// Converts the upper 53 bits of a hash to a number in [0, 1).
pub fn unit(hash: u64) -> f64 {
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// Barycentric weights of a uniformly distributed point on a triangle, from two uniform numbers in [0, 1] (Turk,
/// Graphics Gems, 1990).
pub fn place_on_triangle(across: f64, along: f64) -> [f64; 3] {
    let root = across.sqrt();
    [1.0 - root, root * (1.0 - along), root * along]
}

/// A number from 0 up to 1 that follows from a seed, a part and one of four streams.
pub fn of_stream(seed: u64, part: u64, stream: u64) -> f64 {
    unit(mixed(seed.wrapping_add((part * 4 + stream).wrapping_mul(INCREMENT))))
}

//! Phrases that the glossary of `docs/README.md` retires, in pages and in the source.

pub const PHRASES: [&str; 12] = [
    "gone on with",
    "goes on with",
    "go on with",
    "made anew",
    "anew",
    "is told",
    "are told",
    "so many",
    "had better",
    "nothing if",
    "nothing where",
    "nobody vouches",
];

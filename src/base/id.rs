//! Ids: 32-bit indices of which the compiler keeps each kind apart.
//!
//! An id is an index into the arrays that hold one value for each thing of its kind; a [`TiVec`] can be indexed by
//! nothing else. Ids turn into plain numbers only where they are encoded as bytes.

pub use typed_index_collections::{TiSlice, TiVec};

/// Defines types of ids: `ids! { /// What it numbers. VertexId; }`.
macro_rules! ids {
    ($($(#[$about:meta])* $name:ident;)+) => {$(
        $(#[$about])*
        #[derive(
            Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default,
            bytemuck::Pod, bytemuck::Zeroable, serde::Serialize, serde::Deserialize,
        )]
        #[repr(transparent)]
        #[serde(transparent)]
        pub struct $name(u32);

        impl $name {
            /// Marks the absence of an id in arrays of ids.
            pub const NONE: Self = Self(u32::MAX);

            /// The id with a number.
            #[inline(always)]
            pub const fn new(number: u32) -> Self {
                Self(number)
            }

            /// The number, to be encoded or calculated with.
            #[inline(always)]
            pub const fn number(self) -> u32 {
                self.0
            }

            /// The number as an index.
            #[inline(always)]
            pub const fn index(self) -> usize {
                self.0 as usize
            }

            /// The id; `None` if it is [`NONE`](Self::NONE).
            #[inline(always)]
            pub fn some(self) -> Option<Self> {
                (self != Self::NONE).then_some(self)
            }

            /// The first `count` ids, ascending.
            pub fn first(count: usize) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone {
                (0..count).map(Self::from)
            }
        }

        impl From<usize> for $name {
            #[inline(always)]
            fn from(index: usize) -> Self {
                debug_assert!(index <= u32::MAX as usize, "{index} is no 32-bit id");
                Self(index as u32)
            }
        }

        impl From<$name> for usize {
            #[inline(always)]
            fn from(id: $name) -> Self {
                id.0 as Self
            }
        }
    )+};
}

pub(crate) use ids;

#[cfg(test)]
mod tests {
    use super::*;

    ids! {
        /// A thing.
        Thing;
    }

    #[test]
    fn an_id_indexes_the_values_of_its_kind() {
        let values: TiVec<Thing, char> = "abc".chars().collect();
        assert_eq!(values[Thing::new(1)], 'b');
        assert_eq!(Thing::first(3).map(|id| values[id]).collect::<String>(), "abc");
        assert_eq!((Thing::new(2).some(), Thing::NONE.some()), (Some(Thing::new(2)), None));
        assert_eq!(bytemuck::cast_slice::<Thing, u8>(&[Thing::new(258)]), [2, 1, 0, 0]);
    }
}

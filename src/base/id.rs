//! Ids: 32-bit indices of which the compiler keeps each kind apart.
//!
//! An id is an index into the arrays that hold one value for each thing of its kind; a [`TiVec`] can be indexed by
//! nothing else. Ids turn into plain numbers only where they are encoded as bytes.

use std::fmt::Debug;
use std::hash::Hash;
use std::ops::{Index, IndexMut, Range};

pub use typed_index_collections::{TiSlice, TiVec};

/// An id of any kind, for what is done to all of them alike.
pub trait Id: Copy + Ord + Hash + Debug + Send + Sync + bytemuck::Pod + From<usize> + Into<usize> {
    /// Marks the absence of an id.
    const NONE: Self;

    /// The id with a number.
    fn new(number: u32) -> Self;

    /// The number, to be encoded or calculated with.
    fn number(self) -> u32;

    /// The number as an index.
    #[inline(always)]
    fn index(self) -> usize {
        self.number() as usize
    }
}

/// The numbers of some ids.
pub fn numbers(ids: &[impl Id]) -> &[u32] {
    bytemuck::cast_slice(ids)
}

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

            /// The id `count` places after this one.
            #[inline(always)]
            pub const fn plus(self, count: u32) -> Self {
                Self(self.0 + count)
            }

            /// Its place among the ids from `first` on.
            #[inline(always)]
            pub const fn since(self, first: Self) -> usize {
                (self.0 - first.0) as usize
            }

            /// The id; `None` if it is [`NONE`](Self::NONE).
            #[inline(always)]
            pub fn some(self) -> Option<Self> {
                (self != Self::NONE).then_some(self)
            }

            /// The ids of a range, ascending.
            pub fn within(
                ids: &std::ops::Range<Self>,
            ) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone + use<> {
                (ids.start.index()..ids.end.index()).map(Self::from)
            }

            /// The first `count` ids, ascending.
            pub fn first(count: usize) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator + Clone {
                (0..count).map(Self::from)
            }
        }

        impl $crate::base::id::Id for $name {
            const NONE: Self = Self(u32::MAX);

            #[inline(always)]
            fn new(number: u32) -> Self {
                Self(number)
            }

            #[inline(always)]
            fn number(self) -> u32 {
                self.0
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

/// Values of consecutive ids, the first of which may be any.
#[derive(Debug, Clone)]
pub struct IdWindow<K, V> {
    first: K,
    values: Vec<V>,
}

impl<K: Id, V: Clone> IdWindow<K, V> {
    /// The same value for each of some ids.
    pub fn filled(ids: &Range<K>, value: V) -> Self {
        let count = ids.end.number().saturating_sub(ids.start.number());
        Self::new(ids.start, vec![value; count as usize])
    }
}

impl<K: Id, V> IdWindow<K, V> {
    /// The values of the ids from `first` on.
    pub fn new(first: K, values: Vec<V>) -> Self {
        Self { first, values }
    }

    #[inline]
    fn place(&self, id: K) -> usize {
        id.number().wrapping_sub(self.first.number()) as usize
    }

    /// The value of an id; `None` if the id lies outside.
    #[inline]
    pub fn get(&self, id: K) -> Option<&V> {
        self.values.get(self.place(id))
    }

    /// The same, to be changed.
    #[inline]
    pub fn get_mut(&mut self, id: K) -> Option<&mut V> {
        let place = self.place(id);
        self.values.get_mut(place)
    }

    /// Ids and values, ascending.
    pub fn iter(&self) -> impl Iterator<Item = (K, &V)> {
        (self.first.number()..).map(K::new).zip(&self.values)
    }
}

impl<K: Id, V> Index<K> for IdWindow<K, V> {
    type Output = V;

    #[inline]
    fn index(&self, id: K) -> &V {
        &self.values[self.place(id)]
    }
}

impl<K: Id, V> IndexMut<K> for IdWindow<K, V> {
    #[inline]
    fn index_mut(&mut self, id: K) -> &mut V {
        let place = self.place(id);
        &mut self.values[place]
    }
}

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

    #[test]
    fn a_window_has_values_of_its_ids_alone() {
        let mut window = IdWindow::filled(&(Thing::new(5)..Thing::new(7)), 'a');
        window[Thing::new(6)] = 'b';
        let values: Vec<_> = (4..8).map(|number| window.get(Thing::new(number)).copied()).collect();
        assert_eq!(values, [None, Some('a'), Some('b'), None]);
        assert!(window.iter().eq([(Thing::new(5), &'a'), (Thing::new(6), &'b')]));
    }
}

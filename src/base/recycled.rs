//! Values that keep their memory for the next use.

use std::sync::Mutex;

use super::lock::lock;

/// Values that are not in use; any thread takes one and gives it back.
#[derive(Debug, Default)]
pub struct Recycled<T>(Mutex<Vec<T>>);

impl<T: Default> Recycled<T> {
    /// A value that was given back, or a new one.
    pub fn take(&self) -> T {
        let kept = lock(&self.0).pop();
        kept.unwrap_or_default()
    }

    /// Keeps a value for the next use.
    pub fn give_back(&self, value: T) {
        lock(&self.0).push(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_given_back_is_taken_again() {
        let buffers = Recycled::<Vec<u8>>::default();
        let mut first = buffers.take();
        first.reserve_exact(100);
        buffers.give_back(first);
        assert_eq!((buffers.take().capacity(), buffers.take().capacity()), (100, 0));
    }
}

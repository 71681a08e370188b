//! Reads the numbers of records one after the other, from text or from bytes.
//!
//! In: whole records of an element. Out: numbers, or a message about the first that is not one.

use super::header::Scalar;
use crate::file::float::shortest;
use crate::read::line::{is_blank, line_end, quote};
use crate::read::number::{index_at, is_non_finite_word, number, raise_decimals};

/// What was expected and what was found.
pub(super) type FieldResult<T> = Result<T, String>;

/// Records being read.
pub(super) trait Fields {
    /// Begins the next record.
    fn begin(&mut self);
    /// Ends a record, whose last number was read.
    ///
    /// # Errors
    /// If the record has more numbers.
    fn end(&mut self) -> FieldResult<()>;
    /// Line of the record, from 1 (0 without lines), and its offset.
    fn place(&self) -> (u64, u64);
    /// The next number: a float as the shortest decimal that it stands for, whose decimals are at most `decimals` or
    /// raise them.
    ///
    /// # Errors
    /// If there is no number.
    fn number(&mut self, scalar: Scalar, decimals: &mut u32) -> FieldResult<f64>;
    /// The next integer.
    ///
    /// # Errors
    /// If there is none.
    fn integer(&mut self, scalar: Scalar) -> FieldResult<i64>;
    /// Passes over numbers.
    ///
    /// # Errors
    /// If there are not as many.
    fn skip(&mut self, words: usize, bytes: usize) -> FieldResult<()>;
}

/// A line of words per record.
pub(super) struct TextFields<'a> {
    text: &'a [u8],
    at: usize,
    next: usize,
    line: u64,
    lines_passed: u64,
    words: &'a [u8],
}

impl<'a> TextFields<'a> {
    /// Creates a reader of `text`, whose first line is number `line`.
    pub(super) fn new(text: &'a [u8], line: u64) -> Self {
        Self { text, at: 0, next: 0, line, lines_passed: 0, words: &[] }
    }

    fn word(&mut self) -> FieldResult<&'a [u8]> {
        let start = self.words.iter().position(|byte| !is_blank(*byte)).ok_or("expected a number, found a line end")?;
        let rest = &self.words[start..];
        let end = rest.iter().position(|byte| is_blank(*byte)).unwrap_or(rest.len());
        self.words = &rest[end..];
        Ok(&rest[..end])
    }
}

impl Fields for TextFields<'_> {
    fn begin(&mut self) {
        loop {
            self.line += self.lines_passed;
            self.lines_passed = 1;
            self.at = self.next;
            let (end, next) = line_end(self.text, self.at);
            self.words = &self.text[self.at..end];
            self.next = next;
            if self.next == self.text.len() || !self.words.iter().all(|byte| is_blank(*byte)) {
                return;
            }
        }
    }

    fn end(&mut self) -> FieldResult<()> {
        match self.word() {
            Ok(word) => Err(format!("expected a line end, found '{}'", quote(word))),
            Err(_) => Ok(()),
        }
    }

    fn place(&self) -> (u64, u64) {
        (self.line, 0)
    }

    fn number(&mut self, _: Scalar, decimals: &mut u32) -> FieldResult<f64> {
        let word = self.word()?;
        match number(word) {
            Some(number) => {
                *decimals = number.decimals.max(*decimals);
                Ok(number.value)
            }
            None if is_non_finite_word(word) => Ok(f64::NAN),
            None => Err(format!("expected a number, found '{}'", quote(word))),
        }
    }

    fn integer(&mut self, _: Scalar) -> FieldResult<i64> {
        let word = self.word()?;
        match index_at(word, 0) {
            Some((index, end)) if end == word.len() => {
                let magnitude = index.magnitude.min(i64::MAX as u64) as i64;
                Ok(if index.negative { -magnitude } else { magnitude })
            }
            _ => Err(format!("expected an integer, found '{}'", quote(word))),
        }
    }

    fn skip(&mut self, words: usize, _: usize) -> FieldResult<()> {
        (0..words).try_for_each(|_| self.word().map(drop))
    }
}

/// Numbers in bytes; big-endian if `BIG`.
pub(super) struct BinaryFields<'a, const BIG: bool> {
    bytes: &'a [u8],
    at: usize,
    /// Offset of the first byte in the file.
    offset: u64,
    record_at: usize,
    /// Decimals of the float before.
    last: u32,
}

impl<'a, const BIG: bool> BinaryFields<'a, BIG> {
    /// Creates a reader of `bytes`, which begin at an offset of the file.
    pub(super) fn new(bytes: &'a [u8], offset: u64) -> Self {
        Self { bytes, at: 0, offset, record_at: 0, last: 0 }
    }

    #[inline(always)]
    fn take<const N: usize>(&mut self) -> FieldResult<[u8; N]> {
        let taken = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>());
        let mut taken = *taken.ok_or("expected a number, found the end of the record")?;
        self.at += N;
        if BIG {
            taken.reverse();
        }
        Ok(taken)
    }
}

impl<const BIG: bool> Fields for BinaryFields<'_, BIG> {
    #[inline]
    fn begin(&mut self) {
        self.record_at = self.at;
    }

    fn end(&mut self) -> FieldResult<()> {
        Ok(())
    }

    fn place(&self) -> (u64, u64) {
        (0, self.offset + self.record_at as u64)
    }

    #[inline(always)]
    fn number(&mut self, scalar: Scalar, decimals: &mut u32) -> FieldResult<f64> {
        match scalar {
            Scalar::F32 => {
                let value = shortest(f32::from_le_bytes(self.take()?), &mut self.last);
                *decimals = self.last.max(*decimals);
                Ok(value)
            }
            Scalar::F64 => {
                let value = f64::from_le_bytes(self.take()?);
                raise_decimals(value, decimals);
                Ok(value)
            }
            _ => self.integer(scalar).map(|value| value as f64),
        }
    }

    #[inline(always)]
    fn integer(&mut self, scalar: Scalar) -> FieldResult<i64> {
        Ok(match scalar {
            Scalar::I8 => i64::from(i8::from_le_bytes(self.take()?)),
            Scalar::U8 => i64::from(u8::from_le_bytes(self.take()?)),
            Scalar::I16 => i64::from(i16::from_le_bytes(self.take()?)),
            Scalar::U16 => i64::from(u16::from_le_bytes(self.take()?)),
            Scalar::I32 => i64::from(i32::from_le_bytes(self.take()?)),
            Scalar::U32 => i64::from(u32::from_le_bytes(self.take()?)),
            Scalar::F32 => f32::from_le_bytes(self.take()?) as i64,
            Scalar::F64 => f64::from_le_bytes(self.take()?) as i64,
        })
    }

    #[inline]
    fn skip(&mut self, _: usize, bytes: usize) -> FieldResult<()> {
        self.at += bytes;
        Ok(())
    }
}

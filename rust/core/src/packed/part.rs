//! Counts, numbers, texts, lists and matrices as bytes.

use nalgebra::DMatrix;

use crate::error::{Error, Result};

/// Rows or columns of a matrix: an empty one may claim any, and what is made of it is not empty.
const MOST_ROWS: usize = 4096;

/// What has a place in the file.
pub trait Part: Sized {
    /// Appends it.
    fn put(&self, out: &mut Vec<u8>);

    /// Reads it; takes no more memory than bytes that are there.
    ///
    /// # Errors
    /// [`Error::Format`], and what is made of it may have its own.
    fn take(source: &mut Source) -> Result<Self>;
}

/// Bytes that are read from their beginning.
pub struct Source<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Source<'a> {
    /// Bytes that begin at this place of the file.
    pub fn new(bytes: &'a [u8], at: usize) -> Self {
        Self { bytes, at }
    }

    pub fn take<T: Part>(&mut self) -> Result<T> {
        T::take(self)
    }

    /// Refuses what is left.
    pub fn end(&self) -> Result<()> {
        if self.bytes.is_empty() { Ok(()) } else { Err(self.error("more follows than a stepper has")) }
    }

    pub fn error(&self, what: &'static str) -> Error {
        Error::Format { what, at: self.at }
    }

    fn next(&mut self, count: usize) -> Result<&'a [u8]> {
        let (found, rest) = self.bytes.split_at_checked(count).ok_or(self.error("it is cut short"))?;
        (self.bytes, self.at) = (rest, self.at + count);
        Ok(found)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        self.next(N).map(|found| found.try_into().expect("as many were asked for"))
    }
}

impl Part for u8 {
    fn put(&self, out: &mut Vec<u8>) {
        out.push(*self);
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.array::<1>().map(|[byte]| byte)
    }
}

impl Part for u32 {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.to_le_bytes());
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.array().map(Self::from_le_bytes)
    }
}

impl Part for i32 {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.to_le_bytes());
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.array().map(Self::from_le_bytes)
    }
}

impl Part for usize {
    fn put(&self, out: &mut Vec<u8>) {
        // more than a u32 holds is no size of a loop, and refused when it is read
        u32::try_from(*self).unwrap_or(u32::MAX).put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.take::<u32>().map(|count| count as Self)
    }
}

impl Part for f64 {
    fn put(&self, out: &mut Vec<u8>) {
        out.extend(self.to_le_bytes());
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.array().map(Self::from_le_bytes)
    }
}

impl Part for bool {
    fn put(&self, out: &mut Vec<u8>) {
        u8::from(*self).put(out);
    }

    fn take(source: &mut Source) -> Result<Self> {
        match source.take::<u8>()? {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(source.error("a flag is neither 0 nor 1")),
        }
    }
}

impl Part for String {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        out.extend(self.as_bytes());
    }

    fn take(source: &mut Source) -> Result<Self> {
        let count = source.take()?;
        let text = std::str::from_utf8(source.next(count)?);
        text.map(str::to_owned).map_err(|_| source.error("a text is not UTF-8"))
    }
}

impl<T: Part> Part for Vec<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.len().put(out);
        self.iter().for_each(|member| member.put(out));
    }

    fn take(source: &mut Source) -> Result<Self> {
        (0..source.take::<usize>()?).map(|_| source.take()).collect()
    }
}

impl<T: Part> Part for Option<T> {
    fn put(&self, out: &mut Vec<u8>) {
        self.is_some().put(out);
        self.iter().for_each(|content| content.put(out));
    }

    fn take(source: &mut Source) -> Result<Self> {
        source.take::<bool>()?.then(|| source.take()).transpose()
    }
}

impl Part for DMatrix<f64> {
    fn put(&self, out: &mut Vec<u8>) {
        self.nrows().put(out);
        self.ncols().put(out);
        self.iter().for_each(|value| value.put(out));
    }

    fn take(source: &mut Source) -> Result<Self> {
        let (rows, columns): (usize, usize) = (source.take()?, source.take()?);
        if rows.max(columns) > MOST_ROWS {
            return Err(source.error("a matrix has more rows or columns than a loop that runs"));
        }
        let values = source.next(8 * rows * columns)?.chunks_exact(8);
        let values = values.map(|bytes| f64::from_le_bytes(bytes.try_into().expect("chunks of eight")));
        Ok(Self::from_iterator(rows, columns, values))
    }
}

//! Lines of words and numbers: the part that OBJ, OFF, PLY and STL in text share. Errors name the line.

use super::format::MeshFormat;
use crate::error::MeshError;
use nalgebra::Point3;
use std::fmt::Display;
use std::str::FromStr;

/// Longest part of a word that an error quotes, bytes.
const QUOTED: usize = 40;

/// One line, word by word.
///
/// Bytes, not UTF-8: names and comments, which are skipped, are in any encoding.
pub(super) struct Words<'a> {
    format: MeshFormat,
    /// Number of the line in its file, from 1.
    line: usize,
    rest: &'a [u8],
}

impl<'a> Words<'a> {
    pub fn new(format: MeshFormat, line: usize, text: &'a [u8]) -> Self {
        Self { format, line, rest: text }
    }

    /// The next word, if there is one.
    pub fn next_word(&mut self) -> Option<&'a [u8]> {
        let text = self.rest.trim_ascii_start();
        let end = text.iter().position(u8::is_ascii_whitespace).unwrap_or(text.len());
        let (word, rest) = text.split_at(end);
        self.rest = rest;
        (!word.is_empty()).then_some(word)
    }

    /// Steps over words whose values are not used.
    pub fn skip(&mut self, count: usize) -> Result<(), MeshError> {
        // Ends at the end of the line, however large `count` is.
        (0..count).try_for_each(|_| self.required().map(drop))
    }

    /// The next word as a number.
    pub fn number<T: FromStr>(&mut self) -> Result<T, MeshError> {
        let word = self.required()?;
        self.parse(word)
    }

    /// The next word as a coordinate, which is finite.
    pub fn coordinate<T: FromStr + Into<f64>>(&mut self) -> Result<f64, MeshError> {
        let word = self.required()?;
        let value: f64 = self.parse::<T>(word)?.into();
        if !value.is_finite() {
            let quoted = quote(word);
            return Err(
                self.error(format!("the coordinate {quoted} is not finite; repair the mesh or drop that vertex"))
            );
        }
        Ok(value)
    }

    /// The next three words as a vertex.
    pub fn point<T: FromStr + Into<f64>>(&mut self) -> Result<Point3<f64>, MeshError> {
        Ok(Point3::new(self.coordinate::<T>()?, self.coordinate::<T>()?, self.coordinate::<T>()?))
    }

    /// A word of this line as a number.
    pub fn parse<T: FromStr>(&self, word: &[u8]) -> Result<T, MeshError> {
        let number = std::str::from_utf8(word).ok().and_then(|text| text.parse().ok());
        number.ok_or_else(|| self.error(format!("\"{}\" is not the number expected there", quote(word))))
    }

    /// An error of this line.
    pub fn error(&self, detail: impl Display) -> MeshError {
        MeshError::Malformed { format: self.format.name(), detail: format!("line {}: {detail}", self.line) }
    }

    fn required(&mut self) -> Result<&'a [u8], MeshError> {
        self.next_word().ok_or_else(|| self.error("it has too few numbers"))
    }
}

/// The lines of a text with their numbers, from 1.
pub(super) fn numbered(text: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    text.split(|&b| b == b'\n').enumerate().map(|(index, line)| (index + 1, line))
}

/// A line without its comment, which `#` begins.
pub(super) fn without_comment(line: &[u8]) -> &[u8] {
    line.split(|&b| b == b'#').next().unwrap_or_default()
}

/// A word as an error shows it.
pub(super) fn quote(word: &[u8]) -> String {
    String::from_utf8_lossy(&word[..word.len().min(QUOTED)]).into_owned()
}

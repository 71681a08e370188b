//! Format of images that are written.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Quality of a JPEG unless given.
const QUALITY: u8 = 90;

/// Format of an image file, written `png`, `jpeg` or `jpeg:90`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// PNG, without loss.
    Png,
    /// JPEG of a quality from 1 to 100.
    Jpeg(u8),
}

impl ImageFormat {
    /// Ending of the names of such files.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg(_) => "jpg",
        }
    }

    /// Type of such a file in glTF.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg(_) => "image/jpeg",
        }
    }
}

impl fmt::Display for ImageFormat {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Png => write!(out, "png"),
            Self::Jpeg(quality) => write!(out, "jpeg:{quality}"),
        }
    }
}

impl FromStr for ImageFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            None if text == "png" => Ok(Self::Png),
            None if text == "jpeg" => Ok(Self::Jpeg(QUALITY)),
            Some(("jpeg", quality)) => match quality.parse() {
                Ok(quality @ 1..=100) => Ok(Self::Jpeg(quality)),
                _ => Err(format!("{quality}: expected a quality from 1 to 100")),
            },
            _ => Err("expected png, jpeg or jpeg:QUALITY".into()),
        }
    }
}

impl Serialize for ImageFormat {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for ImageFormat {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(serde::de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_read_as_they_are_written() {
        for (text, format) in
            [("png", ImageFormat::Png), ("jpeg", ImageFormat::Jpeg(90)), ("jpeg:5", ImageFormat::Jpeg(5))]
        {
            assert_eq!(text.parse(), Ok(format));
            assert_eq!(format.to_string().parse(), Ok(format));
        }
        for text in ["", "jpg", "png:3", "jpeg:", "jpeg:0", "jpeg:101", "jpeg:-1", "JPEG:90:2"] {
            assert!(text.parse::<ImageFormat>().is_err(), "{text}");
        }
    }
}

//! Format of images that are written.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Quality of a JPEG, of a WebP and of a KTX2 unless given.
const JPEG_QUALITY: u8 = 90;
const WEBP_QUALITY: u8 = 80;
const KTX2_QUALITY: u8 = 75;
/// Memory of a pixel while it is encoded, in bytes, as measured on 2026-11-27.
const WEBP_BYTES: u64 = 8;
const KTX2_BYTES: u64 = 96;

/// Format of an image file, written `png`, `jpeg`, `jpeg:90`, `webp`, `webp:80`, `ktx2` or `ktx2:75`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ImageFormat {
    /// PNG, without loss.
    Png,
    /// JPEG of a quality from 1 to 100.
    Jpeg(u8),
    /// WebP with loss, of a quality from 1 to 100; for tiles, if the program is built with its feature `webp`.
    WebP(u8),
    /// KTX2 with ETC1S and all its levels, of a quality from 1 to 100; for tiles, if the program is built with its feature
    /// `ktx2`.
    Ktx2(u8),
}

impl ImageFormat {
    /// Ending of the names of such files.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg(_) => "jpg",
            Self::WebP(_) => "webp",
            Self::Ktx2(_) => "ktx2",
        }
    }

    /// Type of such a file in glTF.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Png => "image/png",
            Self::Jpeg(_) => "image/jpeg",
            Self::WebP(_) => "image/webp",
            Self::Ktx2(_) => "image/ktx2",
        }
    }

    /// The extension of glTF that a texture with such a file needs; `None` if it needs none.
    pub fn extension(self) -> Option<&'static str> {
        match self {
            Self::Png | Self::Jpeg(_) => None,
            Self::WebP(_) => Some("EXT_texture_webp"),
            Self::Ktx2(_) => Some("KHR_texture_basisu"),
        }
    }

    /// Memory of a pixel while such an image is encoded, beyond the pixel and the file, in bytes.
    pub fn encoder_bytes(self) -> u64 {
        match self {
            Self::Png | Self::Jpeg(_) => 0,
            Self::WebP(_) => WEBP_BYTES,
            Self::Ktx2(_) => KTX2_BYTES,
        }
    }

    /// Checks that the program writes such files.
    ///
    /// # Errors
    /// What was expected, or how the program has to be built.
    pub fn check(self) -> Result<(), String> {
        let unbuilt = |format: &str, feature: &str, compiler: &str| {
            Err(format!(
                "this program is built without {format}; `cargo build --release --features {feature}` builds it with \
                 {format}, and needs a {compiler} compiler"
            ))
        };
        match self {
            Self::Jpeg(0 | 101..) | Self::WebP(0 | 101..) | Self::Ktx2(0 | 101..) => {
                Err("expected a quality from 1 to 100".into())
            }
            Self::WebP(_) if !cfg!(feature = "webp") => unbuilt("WebP", "webp", "C"),
            Self::Ktx2(_) if !cfg!(feature = "ktx2") => unbuilt("KTX2", "ktx2", "C++"),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for ImageFormat {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Png => write!(out, "png"),
            Self::Jpeg(quality) => write!(out, "jpeg:{quality}"),
            Self::WebP(quality) => write!(out, "webp:{quality}"),
            Self::Ktx2(quality) => write!(out, "ktx2:{quality}"),
        }
    }
}

impl FromStr for ImageFormat {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, quality) = text.split_once(':').map_or((text, None), |(name, quality)| (name, Some(quality)));
        let quality_or = |usual: u8| match quality.map(str::parse) {
            None => Ok(usual),
            Some(Ok(quality @ 1..=100)) => Ok(quality),
            _ => Err(format!("{}: expected a quality from 1 to 100", quality.unwrap_or_default())),
        };
        match (name, quality) {
            ("png", None) => Ok(Self::Png),
            ("jpeg", _) => quality_or(JPEG_QUALITY).map(Self::Jpeg),
            ("webp", _) => quality_or(WEBP_QUALITY).map(Self::WebP),
            ("ktx2", _) => quality_or(KTX2_QUALITY).map(Self::Ktx2),
            _ => Err("expected png, or jpeg, webp or ktx2, with or without :QUALITY".into()),
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
        for (text, format) in [
            ("png", ImageFormat::Png),
            ("jpeg", ImageFormat::Jpeg(90)),
            ("jpeg:5", ImageFormat::Jpeg(5)),
            ("webp", ImageFormat::WebP(80)),
            ("webp:100", ImageFormat::WebP(100)),
            ("ktx2:1", ImageFormat::Ktx2(1)),
        ] {
            assert_eq!(text.parse(), Ok(format));
            assert_eq!(format.to_string().parse(), Ok(format));
        }
        for text in ["", "jpg", "png:3", "jpeg:", "jpeg:0", "jpeg:101", "jpeg:-1", "JPEG:90:2", "webp:", "webp:0"] {
            assert!(text.parse::<ImageFormat>().is_err(), "{text}");
        }
    }
}

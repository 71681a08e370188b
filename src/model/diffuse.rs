//! What a material shows: its diffuse image (`map_Kd`), where that lies, and its diffuse colour (`Kd`).

use glam::DVec2;

use super::catalogue::{MaterialDefinition, TextureStatement};

/// The statement of a material's diffuse image.
pub fn diffuse_image(definition: &MaterialDefinition) -> Option<&TextureStatement> {
    let is_diffuse = |texture: &&TextureStatement| {
        let key = texture.key_and_options.split(u8::is_ascii_whitespace).next().unwrap_or_default();
        key.eq_ignore_ascii_case(b"map_Kd")
    };
    definition.textures.iter().find(is_diffuse)
}

/// The diffuse colour of a material (`Kd`), red, green, blue.
pub fn diffuse_colour(definition: &MaterialDefinition) -> Option<[u8; 3]> {
    let statement = definition.statements.iter().find_map(|text| {
        let text = std::str::from_utf8(text).ok()?;
        let (keyword, values) = text.trim_start().split_once(char::is_whitespace)?;
        keyword.eq_ignore_ascii_case("kd").then_some(values)
    })?;
    let mut values = statement.split_whitespace().map_while(|word| word.parse::<f32>().ok());
    let red = values.next().filter(|value| value.is_finite())?;
    // Those that are left out are as the first.
    let mut next = || values.next().filter(|value| value.is_finite()).unwrap_or(red);
    Some([red, next(), next()].map(|value| (255.0 * value.clamp(0.0, 1.0)).round() as u8))
}

/// Where an image lies on the surface: the options `-s` and `-o` of a texture statement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImagePlacement {
    scale: DVec2,
    offset: DVec2,
}

impl ImagePlacement {
    /// Reads the options of a statement; `None` if they leave the image where it is.
    pub fn of(texture: &TextureStatement) -> Option<Self> {
        let mut placement = Self { scale: DVec2::ONE, offset: DVec2::ZERO };
        let words: Vec<&str> = texture
            .key_and_options
            .split(u8::is_ascii_whitespace)
            .filter_map(|word| std::str::from_utf8(word).ok())
            .filter(|word| !word.is_empty())
            .collect();
        for (at, option) in words.iter().enumerate() {
            let mut values = words[at + 1..].iter().map_while(|word| word.parse::<f64>().ok());
            let target = match *option {
                "-s" | "-S" => &mut placement.scale,
                "-o" | "-O" => &mut placement.offset,
                _ => continue,
            };
            target.x = values.next().unwrap_or(target.x);
            target.y = values.next().unwrap_or(target.y);
        }
        let is_finite = placement.scale.is_finite() && placement.offset.is_finite();
        (is_finite && placement != Self { scale: DVec2::ONE, offset: DVec2::ZERO }).then_some(placement)
    }

    /// The texture coordinate in the image at one of the file.
    #[inline]
    pub fn place(self, texcoord: DVec2) -> DVec2 {
        texcoord * self.scale + self.offset
    }

    /// How many times the image is shown on an area of the file's texture space that it would fill once.
    pub fn repeats(self) -> f64 {
        (self.scale.x * self.scale.y).abs()
    }
}

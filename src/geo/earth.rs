//! The ellipsoid of WGS 84, and frames on it.

use std::str::FromStr;

use glam::{DMat4, DVec3};
use serde::{Deserialize, Serialize};

/// Largest height in metres, above or below the ellipsoid.
const HEIGHT_MAX: f64 = 1e5;

/// A place on earth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct GeoPlace {
    /// Degrees east.
    pub longitude: f64,
    /// Degrees north.
    pub latitude: f64,
    /// Metres above the ellipsoid.
    pub height: f64,
}

impl GeoPlace {
    /// Whether it lies within 100 km of the surface of the earth.
    pub fn is_on_earth(&self) -> bool {
        self.longitude.abs() <= 180.0 && self.latitude.abs() <= 90.0 && self.height.abs() <= HEIGHT_MAX
    }
}

impl FromStr for GeoPlace {
    type Err = String;

    /// Reads `longitude,latitude` or `longitude,latitude,height`; without a height it is 0.
    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<f64>> = text.split(',').map(|word| word.trim().parse().ok()).collect();
        let (longitude, latitude, height) = match numbers.as_deref() {
            Some(&[longitude, latitude]) => (longitude, latitude, 0.0),
            Some(&[longitude, latitude, height]) => (longitude, latitude, height),
            _ => return Err("expected LONGITUDE,LATITUDE[,HEIGHT] in degrees and metres".into()),
        };
        let place = Self { longitude, latitude, height };
        let refused = || "expected degrees within 180 and 90, and metres within 100000".to_owned();
        place.is_on_earth().then_some(place).ok_or_else(refused)
    }
}

/// From metres east, north and up of a place to earth-centred coordinates.
///
/// # Source
/// NIMA TR8350.2, World Geodetic System 1984.
pub fn east_north_up(place: GeoPlace) -> DMat4 {
    const RADIUS: f64 = 6_378_137.0;
    const FLATTENING: f64 = 1.0 / 298.257_223_563;
    let eccentricity_sq = FLATTENING * (2.0 - FLATTENING);
    let (longitude, latitude) = (place.longitude.to_radians(), place.latitude.to_radians());
    let (sin_lon, cos_lon) = (libm::sin(longitude), libm::cos(longitude));
    let (sin_lat, cos_lat) = (libm::sin(latitude), libm::cos(latitude));
    let up = DVec3::new(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat);
    let east = DVec3::new(-sin_lon, cos_lon, 0.0);
    let north = up.cross(east);
    let normal = RADIUS / (1.0 - eccentricity_sq * sin_lat * sin_lat).sqrt();
    let flat = normal + place.height;
    let middle = DVec3::new(
        flat * cos_lat * cos_lon,
        flat * cos_lat * sin_lon,
        (normal * (1.0 - eccentricity_sq) + place.height) * sin_lat,
    );
    DMat4::from_cols(east.extend(0.0), north.extend(0.0), up.extend(0.0), middle.extend(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_height_may_be_left_out() {
        assert_eq!("1,2".parse(), Ok(GeoPlace { longitude: 1.0, latitude: 2.0, height: 0.0 }));
        assert_eq!("1, 2, 3".parse(), Ok(GeoPlace { longitude: 1.0, latitude: 2.0, height: 3.0 }));
        for text in ["1", "1,2,3,4", "1,2,"] {
            assert!(text.parse::<GeoPlace>().unwrap_err().contains("LONGITUDE,LATITUDE[,HEIGHT]"), "{text}");
        }
    }

    #[test]
    fn a_place_on_earth_is_where_the_formulas_say() {
        let of = |longitude, latitude, height| east_north_up(GeoPlace { longitude, latitude, height });
        let at = |transform: DMat4| transform.transform_point3(DVec3::ZERO);
        assert!((at(of(0.0, 0.0, 0.0)) - DVec3::new(6_378_137.0, 0.0, 0.0)).length() < 1e-6);
        assert!((at(of(0.0, 90.0, 10.0)) - DVec3::new(0.0, 0.0, 6_356_762.314_245)).length() < 1e-3);
        // PROJ 9: echo 118.9219 32.1038 20 | cct +proj=cart +ellps=WGS84
        let nanjing = of(118.9219, 32.1038, 20.0);
        let east = nanjing.transform_vector3(DVec3::X);
        assert!(east.z == 0.0 && (east.length() - 1.0).abs() < 1e-12);
        assert!(nanjing.transform_vector3(DVec3::Z).dot(at(nanjing)) > 6.3e6);
    }
}

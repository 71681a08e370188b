//! Coordinate reference systems of maps, by their EPSG code or a PROJ string.

use std::f64::consts::{FRAC_PI_2, TAU};
use std::fmt;

use glam::{DMat4, DVec3};
use proj4rs::Proj;
use proj4rs::transform::transform;

use super::earth::{GeoPlace, east_north_up};

const EARTH_CENTRED: &str = "+proj=geocent +datum=WGS84 +units=m +no_defs";
const GEOGRAPHIC: &str = "+proj=longlat +datum=WGS84 +no_defs";
/// Largest distance in metres between a place and the same place projected there and back.
const THERE_AND_BACK: f64 = 0.01;

/// A coordinate reference system.
pub struct Crs {
    own: Proj,
    /// By what heights are multiplied before they are projected.
    height_scale: f64,
    earth_centred: Proj,
    geographic: Proj,
}

impl Crs {
    /// Finds the system that a text names: `EPSG:32650`, or a PROJ string such as `+proj=utm +zone=50`.
    ///
    /// # Errors
    /// Words, if no system has that name, or its projection cannot be undone.
    pub fn parse(text: &str) -> Result<Self, String> {
        let expected = "expected EPSG:CODE or a PROJ string such as '+proj=utm +zone=50 +datum=WGS84'";
        let of = |text: &str| Proj::from_user_string(text).map_err(|error| format!("{error}; {expected}"));
        let own = of(&text.trim().replacen("epsg:", "EPSG:", 1))?;
        if !own.has_inverse() {
            return Err(format!("the projection {} cannot be undone", own.projname()));
        }
        // A unit of heights alone is applied with the projection.
        let takes_unit = !own.is_latlong() && !own.is_geocent() && own.vto_meter() == 1.0;
        let height_scale = if takes_unit { own.to_meter() } else { 1.0 };
        Ok(Self { own, height_scale, earth_centred: of(EARTH_CENTRED)?, geographic: of(GEOGRAPHIC)? })
    }

    /// Earth-centred coordinates of a position; `None` where the system does not reach.
    ///
    /// Angles are in degrees; heights in the unit of the other coordinates, or metres with angles, above the ellipsoid.
    pub fn to_earth(&self, position: DVec3) -> Option<DVec3> {
        let mut point = (position.x, position.y, position.z);
        if self.own.is_latlong() {
            point = (position.x.to_radians(), position.y.to_radians(), position.z);
            let is_angle = point.0.abs() <= TAU && point.1.abs() <= FRAC_PI_2;
            return is_angle.then(|| moved(&self.own, &self.earth_centred, point)).flatten();
        }
        point.2 *= self.height_scale;
        moved(&self.own, &self.earth_centred, point)
    }

    /// The place of a position; `None` where the system does not reach.
    pub fn place_of(&self, position: DVec3) -> Option<GeoPlace> {
        let earth = self.to_earth(position)?;
        let at = moved(&self.earth_centred, &self.geographic, (earth.x, earth.y, earth.z))?;
        let place = GeoPlace { longitude: at.x.to_degrees(), latitude: at.y.to_degrees(), height: at.z };
        let is_there = |place: &GeoPlace| place.is_on_earth() && self.returns(position, earth);
        Some(place).filter(is_there)
    }

    /// Whether a position is found again from its place on earth: far outside of its zone a projection folds.
    fn returns(&self, position: DVec3, earth: DVec3) -> bool {
        let Some(mut back) = moved(&self.earth_centred, &self.own, (earth.x, earth.y, earth.z)) else { return false };
        if self.own.is_latlong() {
            (back.x, back.y) = (back.x.to_degrees(), back.y.to_degrees());
        }
        let again = self.to_earth(DVec3::new(back.x, back.y, position.z));
        again.is_some_and(|again| again.distance(earth) <= THERE_AND_BACK)
    }
}

impl fmt::Debug for Crs {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Crs").field(&self.own.projname()).finish()
    }
}

fn moved(from: &Proj, to: &Proj, mut point: (f64, f64, f64)) -> Option<DVec3> {
    transform(from, to, &mut point).ok()?;
    Some(DVec3::from(point)).filter(|point| point.is_finite())
}

/// A frame of metres east, north and up of a place, for positions in a coordinate reference system.
#[derive(Debug)]
pub struct EarthFrame {
    crs: Crs,
    /// From the input's coordinates to those of the system.
    to_crs: DMat4,
    from_earth: DMat4,
    /// Where its (0, 0, 0) is.
    pub origin: GeoPlace,
}

impl EarthFrame {
    /// The frame at a position of the input; `to_crs` brings its positions to the coordinates of the system.
    ///
    /// # Errors
    /// Words, if the position has no place on earth.
    pub fn at(crs: Crs, to_crs: DMat4, position: DVec3) -> Result<Self, String> {
        let in_crs = to_crs.transform_point3(position);
        let origin = crs.place_of(in_crs).ok_or_else(|| {
            let DVec3 { x, y, z } = in_crs;
            format!("({x}, {y}, {z}) is no place on earth in this system; `offset` is added to the coordinates")
        })?;
        Ok(Self { crs, to_crs, from_earth: east_north_up(origin).inverse(), origin })
    }

    /// A position in the frame, in metres; `None` where the system does not reach.
    pub fn place(&self, position: DVec3) -> Option<DVec3> {
        let earth = self.crs.to_earth(self.to_crs.transform_point3(position))?;
        Some(self.from_earth.transform_point3(earth))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_zone_is_where_the_standard_says() {
        // PROJ 9: echo 681395.35 3553521.53 20 | cs2cs EPSG:32650 EPSG:4979 -f %.8f, and the like.
        for (name, position, place) in [
            ("EPSG:32650", DVec3::new(500_000.0, 0.0, 7.0), [117.0, 0.0, 7.0]),
            ("+proj=utm +zone=50 +south +datum=WGS84", DVec3::new(500_000.0, 1e7, 0.0), [117.0, 0.0, 0.0]),
            ("epsg:4326", DVec3::new(118.9219, 32.1038, 20.0), [118.9219, 32.1038, 20.0]),
            ("EPSG:4978", DVec3::new(6_378_147.0, 0.0, 0.0), [0.0, 0.0, 10.0]),
        ] {
            let found = Crs::parse(name).unwrap().place_of(position).unwrap();
            let off = DVec3::new(found.longitude, found.latitude, found.height) - DVec3::from(place);
            assert!(off.length() < 1e-6, "{name}: {found:?}");
        }
    }

    #[test]
    fn heights_have_the_unit_of_the_map() {
        let crs = Crs::parse("+proj=utm +zone=18 +datum=WGS84 +units=us-ft").unwrap();
        let foot = 1200.0 / 3937.0;
        let place = crs.place_of(DVec3::new(500_000.0 / foot, 0.0, 100.0)).unwrap();
        assert!((place.longitude + 75.0).abs() < 1e-9 && (place.height - 100.0 * foot).abs() < 1e-6, "{place:?}");
    }

    #[test]
    fn what_is_no_system_is_told() {
        for text in ["", "EPSG:", "EPSG:1", "EPSG:99999999", "UTM 50N", "+proj=nonsense", "+zone=50"] {
            assert!(Crs::parse(text).is_err(), "{text}");
        }
        let crs = Crs::parse("EPSG:4326").unwrap();
        assert_eq!(crs.to_earth(DVec3::new(0.0, 91.0, 0.0)), None);
        let crs = Crs::parse("EPSG:32650").unwrap();
        assert_eq!(crs.place_of(DVec3::new(5e8, 0.0, 0.0)), None);
        assert_eq!(crs.to_earth(DVec3::new(f64::NAN, 0.0, 0.0)), None);
    }

    proptest! {
        /// Lengths of the frame are those on the ground: those of the zone by its scale, .9996 at the middle.
        #[test]
        fn a_frame_keeps_lengths(east in 300e3..700e3f64, north in 1e6..8e6f64, step in prop::array::uniform3(-1e3..1e3f64)) {
            let at = DVec3::new(east, north, 50.0);
            let frame = EarthFrame::at(Crs::parse("EPSG:32633").unwrap(), DMat4::IDENTITY, at).unwrap();
            prop_assert!(frame.place(at).unwrap().length() < 1e-6);
            let step = DVec3::from(step);
            let length = frame.place(at + step).unwrap().length();
            prop_assert!((length / step.length() - 1.0).abs() < 1.5e-3, "{length} for {}", step.length());
        }
    }
}

//! Quadratic error functions of a position, and of a position with a texture coordinate.
//!
//! # Source
//! Garland & Heckbert, "Surface simplification using quadric error metrics", 1997: the sum of squared distances to
//! planes, p·Ap + 2 b·p + c. Hoppe, "New quadric metric for simplifying meshes with appearance attributes", 1999: an
//! attribute s that is g·p + d on a face has the error (g·p + d - s)².
//!
//! | symbol | here |
//! | --- | --- |
//! | A, b, c | [`Quadric`] |
//! | g, d | gradient and offset of a texture coordinate over a face |
//! | Σ area·g, Σ area·d | [`WedgeQuadric::gradient`], [`WedgeQuadric::offset`] |
//!
//! # Memory
//! 80 bytes a vertex, 72 bytes a wedge.

use glam::{DMat3, DVec2, DVec3};

/// p ↦ p·Ap + 2 b·p + c, with symmetric A.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quadric {
    /// xx, yy, zz of A.
    pub diagonal: DVec3,
    /// yz, zx, xy of A.
    pub mixed: DVec3,
    /// b.
    pub linear: DVec3,
    /// c.
    pub constant: f64,
}

impl Quadric {
    /// weight · (n·p + d)²: the weighted squared distance to a plane with unit normal n.
    #[inline]
    pub fn plane(normal: DVec3, offset: f64, weight: f64) -> Self {
        let scaled = normal * weight;
        Self {
            diagonal: scaled * normal,
            mixed: DVec3::new(scaled.y * normal.z, scaled.z * normal.x, scaled.x * normal.y),
            linear: scaled * offset,
            constant: weight * offset * offset,
        }
    }

    /// Value at a position.
    #[inline]
    pub fn at(&self, p: DVec3) -> f64 {
        self.apply(p).dot(p) + 2.0 * self.linear.dot(p) + self.constant
    }

    /// The quadric times `weight`.
    #[inline]
    pub fn scaled(&self, weight: f64) -> Self {
        Self {
            diagonal: self.diagonal * weight,
            mixed: self.mixed * weight,
            linear: self.linear * weight,
            constant: self.constant * weight,
        }
    }

    /// A·p.
    #[inline]
    pub fn apply(&self, p: DVec3) -> DVec3 {
        let (d, m) = (self.diagonal, self.mixed);
        DVec3::new(
            d.x * p.x + m.z * p.y + m.y * p.z,
            m.z * p.x + d.y * p.y + m.x * p.z,
            m.y * p.x + m.x * p.y + d.z * p.z,
        )
    }

    /// The minimiser, with a spring of stiffness `spring` (in units of A) to `from`. `None` if the system is singular
    /// even with the spring.
    #[inline]
    pub fn minimum_near(&self, from: DVec3, spring: f64) -> Option<DVec3> {
        let residual = self.apply(from) + self.linear;
        let d = self.diagonal + DVec3::splat(spring);
        let m = self.mixed;
        let matrix = DMat3::from_cols(DVec3::new(d.x, m.z, m.y), DVec3::new(m.z, d.y, m.x), DVec3::new(m.y, m.x, d.z));
        let cofactors = DMat3::from_cols(
            matrix.y_axis.cross(matrix.z_axis),
            matrix.z_axis.cross(matrix.x_axis),
            matrix.x_axis.cross(matrix.y_axis),
        );
        let determinant = matrix.x_axis.dot(cofactors.x_axis);
        let step = -(cofactors.transpose() * residual) / determinant;
        (determinant > 0.0 && step.is_finite()).then(|| from + step)
    }
}

impl std::ops::AddAssign for Quadric {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.diagonal += other.diagonal;
        self.mixed += other.mixed;
        self.linear += other.linear;
        self.constant += other.constant;
    }
}

impl std::ops::Add for Quadric {
    type Output = Self;

    #[inline]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

/// The part of the texture error that depends on the wedge: Σ area·(s² - 2 s (g·p + d)) for u and v.
///
/// The rest, Σ area·(g·p + d)², does not depend on s: it is a [`Quadric`] of the vertex.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct WedgeQuadric {
    /// Σ area·g for u and v.
    pub gradient: [DVec3; 2],
    /// Σ area·d for u and v.
    pub offset: DVec2,
    /// Σ area.
    pub weight: f64,
}

impl WedgeQuadric {
    /// The texture error of one face, times `weight`: the part of the wedge and the part of the vertex. `None` if the
    /// face has no area or no texture coordinates.
    ///
    /// The gradient lies in the face's plane.
    pub fn of_face(triangle: [DVec3; 3], uv: [DVec2; 3], normal: DVec3, weight: f64) -> Option<(Self, Quadric)> {
        let (e1, e2) = (triangle[1] - triangle[0], triangle[2] - triangle[0]);
        let across = e1.cross(e2);
        let area_sq = across.dot(across);
        if area_sq <= 0.0 || !uv.iter().all(|t| t.is_finite()) {
            return None;
        }
        let (across1, across2) = (e2.cross(across) / area_sq, across.cross(e1) / area_sq);
        let (d1, d2) = (uv[1] - uv[0], uv[2] - uv[0]);
        let mut wedge = Self { weight, ..Self::default() };
        let mut vertex = Quadric::default();
        for axis in 0..2 {
            let mut gradient = across1 * d1[axis] + across2 * d2[axis];
            gradient -= normal * gradient.dot(normal);
            let offset = uv[0][axis] - gradient.dot(triangle[0]);
            wedge.gradient[axis] = gradient * weight;
            wedge.offset[axis] = offset * weight;
            vertex += Quadric::plane(gradient, offset, weight);
        }
        (wedge.gradient[0].is_finite() && wedge.gradient[1].is_finite()).then_some((wedge, vertex))
    }

    /// Value at a position and texture coordinate.
    #[inline]
    pub fn at(&self, p: DVec3, uv: DVec2) -> f64 {
        let mapped = self.mapped(p);
        self.weight * uv.length_squared() - 2.0 * uv.dot(mapped)
    }

    /// Adds to `quadric` the value of [`at`](WedgeQuadric::at) as a function of the position, for a fixed texture
    /// coordinate.
    #[inline]
    pub fn add_held(&self, uv: DVec2, quadric: &mut Quadric) {
        quadric.linear -= self.gradient[0] * uv.x + self.gradient[1] * uv.y;
        quadric.constant += self.weight * uv.length_squared() - 2.0 * uv.dot(self.offset);
    }

    /// Weight times the texture coordinate of least error at a position.
    #[inline]
    pub fn mapped(&self, p: DVec3) -> DVec2 {
        DVec2::new(self.gradient[0].dot(p), self.gradient[1].dot(p)) + self.offset
    }

    /// The quadric of the position that remains when the texture coordinate is always that of least error.
    #[inline]
    pub fn eliminated(&self) -> Quadric {
        let mut quadric = Quadric::default();
        if self.weight > 0.0 {
            for axis in 0..2 {
                quadric += Quadric::plane(self.gradient[axis], self.offset[axis], -1.0 / self.weight);
            }
        }
        quadric
    }
}

impl std::ops::AddAssign for WedgeQuadric {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        self.gradient[0] += other.gradient[0];
        self.gradient[1] += other.gradient[1];
        self.offset += other.offset;
        self.weight += other.weight;
    }
}

impl std::ops::Add for WedgeQuadric {
    type Output = Self;

    #[inline]
    fn add(mut self, other: Self) -> Self {
        self += other;
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [DVec3; 3] = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 2.5, 3.0), DVec3::new(1.5, 5.0, 3.0)];
    const UV: [DVec2; 3] = [DVec2::new(0.1, 0.2), DVec2::new(0.5, 0.1), DVec2::new(0.2, 0.9)];

    #[test]
    fn a_plane_quadric_is_the_squared_distance() {
        let quadric = Quadric::plane(DVec3::Z, -3.0, 2.0);
        assert!((quadric.at(DVec3::new(7.0, 8.0, 5.0)) - 8.0).abs() < 1e-12);
    }

    #[test]
    fn the_minimum_of_three_planes_is_where_they_meet() {
        let quadric = Quadric::plane(DVec3::X, -1.0, 1.0)
            + Quadric::plane(DVec3::Y, -2.0, 1.0)
            + Quadric::plane(DVec3::Z, -3.0, 1.0);
        let minimum = quadric.minimum_near(DVec3::ZERO, 1e-12).unwrap();
        assert!((minimum - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9);
    }

    #[test]
    fn the_minimum_on_a_plane_is_the_foot_of_the_start() {
        let minimum = Quadric::plane(DVec3::Z, -3.0, 1.0).minimum_near(DVec3::new(5.0, 6.0, 0.0), 1e-6).unwrap();
        assert!((minimum - DVec3::new(5.0, 6.0, 3.0)).length() < 1e-4);
    }

    #[test]
    fn texture_error_is_zero_on_the_face_and_squared_beside_it() {
        let (wedge, vertex) = WedgeQuadric::of_face(TRIANGLE, UV, DVec3::Z, 2.0).unwrap();
        for (p, uv) in TRIANGLE.into_iter().zip(UV) {
            assert!((vertex.at(p) + wedge.at(p, uv)).abs() < 1e-12);
            let off = uv + DVec2::new(0.3, 0.4);
            assert!((vertex.at(p) + wedge.at(p, off) - 0.5).abs() < 1e-12);
            assert!((vertex.at(p) + wedge.eliminated().at(p)).abs() < 1e-12);
        }
    }
}

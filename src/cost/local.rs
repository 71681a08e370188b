//! Error quadrics relative to their own vertex, in single precision.
//!
//! Right after a mesh was read, all planes of a vertex pass through it and its texture coordinates fit exactly. In a
//! frame whose origin is the vertex only the quadratic part is then nonzero, so single precision is enough. Merged
//! quadrics add linear and constant parts, translated from the frame of the vanished vertex.
//!
//! ```text
//! error of moving the vertex by d and its texture coordinate by s:
//!   d·Ad + 2 b·d + c  +  Σ wedges  w |s|² - 2 s·(G d + o)
//! ```
//!
//! # Source
//! As in [`quadric`](super::quadric): Garland & Heckbert 1997, Hoppe 1999.
//!
//! # Memory
//! 40 bytes a vertex, 36 bytes a wedge: half of what doubles in one frame would take.

use glam::{DVec3, Vec2, Vec3, Vec3A, Vec3Swizzles};

use super::quadric::{Quadric, WedgeQuadric};

/// d ↦ d·Ad + 2 b·d + c, with symmetric A, for a displacement d of the vertex.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LocalQuadric {
    /// xx, yy, zz, yz, zx, xy of A.
    pub quadratic: [f32; 6],
    /// b.
    pub linear: Vec3,
    /// c: the error at the vertex itself.
    pub constant: f32,
}

impl LocalQuadric {
    /// Adds weight · (n·d)²: the squared distance to a plane through the vertex.
    #[inline]
    pub fn add_plane(&mut self, normal: Vec3, weight: f32) {
        let mut planes = Planes::default();
        planes.add(normal.into(), weight);
        self.add_quadratic(&planes.quadratic());
    }

    /// Adds the quadratic part of another quadric with the same origin.
    #[inline(always)]
    pub fn add_quadratic(&mut self, other: &[f32; 6]) {
        self.quadratic.iter_mut().zip(other).for_each(|(own, other)| *own += other);
    }

    /// A·d.
    #[inline(always)]
    pub fn apply(&self, d: Vec3) -> Vec3 {
        let [xx, yy, zz, yz, zx, xy] = self.quadratic;
        Vec3::new(xx * d.x + xy * d.y + zx * d.z, xy * d.x + yy * d.y + yz * d.z, zx * d.x + yz * d.y + zz * d.z)
    }

    /// Value at a displacement d.
    #[inline(always)]
    pub fn at(&self, d: Vec3) -> f32 {
        (self.apply(d) + 2.0 * self.linear).dot(d) + self.constant
    }

    /// The same in double precision.
    pub fn widened(&self) -> Quadric {
        let [xx, yy, zz, yz, zx, xy] = self.quadratic.map(f64::from);
        Quadric {
            diagonal: DVec3::new(xx, yy, zz),
            mixed: DVec3::new(yz, zx, xy),
            linear: self.linear.as_dvec3(),
            constant: f64::from(self.constant),
        }
    }
}

/// A sum of squared distances to planes through one point.
#[derive(Debug, Clone, Copy, Default)]
pub struct Planes {
    /// xx, yy, zz of A.
    diagonal: Vec3A,
    /// yz, zx, xy of A.
    mixed: Vec3A,
}

impl Planes {
    /// Adds weight · (n·d)².
    #[inline(always)]
    pub fn add(&mut self, normal: Vec3A, weight: f32) {
        let scaled = normal * weight;
        self.diagonal += scaled * normal;
        self.mixed += scaled.yzx() * normal.zxy();
    }

    /// For [`LocalQuadric::add_quadratic`].
    #[inline(always)]
    pub fn quadratic(&self) -> [f32; 6] {
        let (diagonal, mixed) = (self.diagonal, self.mixed);
        [diagonal.x, diagonal.y, diagonal.z, mixed.x, mixed.y, mixed.z]
    }
}

/// The part of the texture error that depends on the wedge; see [`WedgeQuadric`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LocalWedge {
    /// G: Σ area · gradient of u and of v.
    pub gradient: [Vec3; 2],
    /// o: Σ area · offset, 0 until something merges.
    pub offset: Vec2,
    /// w: Σ area.
    pub weight: f32,
}

impl LocalWedge {
    /// G d + o.
    #[inline(always)]
    pub fn mapped(&self, d: Vec3) -> Vec2 {
        Vec2::new(self.gradient[0].dot(d), self.gradient[1].dot(d)) + self.offset
    }

    /// Its value for a displacement d of the vertex and s of the texture coordinate.
    #[inline(always)]
    pub fn at(&self, d: Vec3, s: Vec2) -> f32 {
        s.dot(s * self.weight - 2.0 * self.mapped(d))
    }

    /// The same in double precision.
    pub fn widened(&self) -> WedgeQuadric {
        WedgeQuadric {
            gradient: self.gradient.map(|g| g.as_dvec3()),
            offset: self.offset.as_dvec2(),
            weight: f64::from(self.weight),
        }
    }
}

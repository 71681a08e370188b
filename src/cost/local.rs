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

use std::ops::{Add, Mul, Sub};

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec2, Vec3, Vec3A, Vec3Swizzles, Vec4};

use super::quadric::{Quadric, WedgeQuadric};

/// A number, or several that are calculated with together.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Add<f32, Output = Self> + Mul<f32, Output = Self>
{
}

impl Real for f32 {}
impl Real for Vec4 {}

/// Adds numbers to others, four at a time.
#[inline(always)]
fn add_each<const COUNT: usize>(own: &mut [f32; COUNT], other: &[f32; COUNT]) {
    let (own, own_rest) = own.as_chunks_mut();
    let (other, other_rest) = other.as_chunks();
    own.iter_mut()
        .zip(other)
        .for_each(|(own, &other)| *own = (Vec4::from_array(*own) + Vec4::from_array(other)).into());
    own_rest.iter_mut().zip(other_rest).for_each(|(own, other)| *own += other);
}

/// d ↦ d·Ad + 2 b·d + c, with symmetric A, for a displacement d of the vertex.
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
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
        self.add(&Self { quadratic: planes.quadratic(), ..Self::default() });
    }

    /// Adds another quadric with the same origin.
    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        add_each::<10>(bytemuck::cast_mut(self), bytemuck::cast_ref(other));
    }

    /// A·d.
    #[inline(always)]
    pub fn apply<R: Real>(&self, [x, y, z]: [R; 3]) -> [R; 3] {
        let [xx, yy, zz, yz, zx, xy] = self.quadratic;
        [x * xx + y * xy + z * zx, x * xy + y * yy + z * yz, x * zx + y * yz + z * zz]
    }

    /// Value at a displacement d, or at several.
    #[inline(always)]
    pub fn at<R: Real>(&self, d: [R; 3]) -> R {
        let (a, b) = (self.apply(d), 2.0 * self.linear);
        (a[0] + b.x) * d[0] + (a[1] + b.y) * d[1] + (a[2] + b.z) * d[2] + self.constant
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

    /// For [`LocalQuadric::quadratic`].
    #[inline(always)]
    pub fn quadratic(&self) -> [f32; 6] {
        let (diagonal, mixed) = (self.diagonal, self.mixed);
        [diagonal.x, diagonal.y, diagonal.z, mixed.x, mixed.y, mixed.z]
    }
}

/// The part of the texture error that depends on the wedge; see [`WedgeQuadric`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct LocalWedge {
    /// G: Σ area · gradient of u and of v.
    pub gradient: [Vec3; 2],
    /// w: Σ area.
    pub weight: f32,
    /// o: Σ area · offset, 0 until something merges.
    pub offset: Vec2,
}

impl LocalWedge {
    /// Adds what another wedge of the same vertex has.
    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        add_each::<9>(bytemuck::cast_mut(self), bytemuck::cast_ref(other));
    }

    /// G d + o.
    #[inline(always)]
    pub fn mapped<R: Real>(&self, d: [R; 3]) -> [R; 2] {
        let along = |gradient: Vec3| d[0] * gradient.x + d[1] * gradient.y + d[2] * gradient.z;
        [along(self.gradient[0]) + self.offset.x, along(self.gradient[1]) + self.offset.y]
    }

    /// Its value for a displacement d of the vertex and s of the texture coordinate, or for several.
    #[inline(always)]
    pub fn at<R: Real>(&self, d: [R; 3], s: [R; 2]) -> R {
        let mapped = self.mapped(d);
        s[0] * (s[0] * self.weight - mapped[0] * 2.0) + s[1] * (s[1] * self.weight - mapped[1] * 2.0)
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

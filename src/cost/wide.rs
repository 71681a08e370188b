//! Quadrics over positions with attributes: the squared distance to a triangle's plane in N dimensions.
//!
//! # Source
//! Garland & Heckbert, "Simplifying surfaces with color and texture using quadric error metrics", Visualization 1998.
//! For a triangle (p, q, r): e1 = (q - p) / |q - p|, e2 the unit vector of r - p - (e1·(r - p)) e1; A = I - e1 e1ᵀ - e2
//! e2ᵀ, b = (p·e1) e1 + (p·e2) e2 - p, c = p·p - (p·e1)² - (p·e2)²; the distance² of v is vᵀAv + 2 b·v + c.
//!
//! # Memory
//! 8 (M + N + 1) bytes: 168 for N = 5, 360 for N = 8.

use nalgebra::{Cholesky, SMatrix, SVector};

/// A pivot of the Cholesky factor counts as zero if its square is below this share of the trace.
const PIVOT_SHARE: f64 = 1e-9;

/// v ↦ vᵀAv + 2 b·v + c over N dimensions; M = N (N + 1) / 2 entries of A are stored.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WideQuadric<const N: usize, const M: usize> {
    /// Lower half of A, row by row.
    a: [f64; M],
    b: [f64; N],
    c: f64,
}

impl<const N: usize, const M: usize> Default for WideQuadric<N, M> {
    fn default() -> Self {
        Self { a: [0.0; M], b: [0.0; N], c: 0.0 }
    }
}

fn dot<const N: usize>(a: &[f64; N], b: &[f64; N]) -> f64 {
    (0..N).map(|i| a[i] * b[i]).sum()
}

fn direction<const N: usize>(v: [f64; N]) -> Option<[f64; N]> {
    let length = dot(&v, &v).sqrt();
    (length.is_normal()).then(|| v.map(|x| x / length))
}

impl<const N: usize, const M: usize> WideQuadric<N, M> {
    /// The squared distance to the plane of a triangle; `None` if the triangle is degenerate.
    pub fn of_triangle([p, q, r]: [[f64; N]; 3]) -> Option<Self> {
        let minus = |a: &[f64; N], b: &[f64; N]| -> [f64; N] { std::array::from_fn(|i| a[i] - b[i]) };
        let e1 = direction(minus(&q, &p))?;
        let along = minus(&r, &p);
        let share = dot(&e1, &along);
        let e2 = direction(std::array::from_fn(|i| along[i] - share * e1[i]))?;
        let (p1, p2) = (dot(&p, &e1), dot(&p, &e2));
        let mut quadric = Self { c: dot(&p, &p) - p1 * p1 - p2 * p2, ..Self::default() };
        for i in 0..N {
            quadric.b[i] = p1 * e1[i] + p2 * e2[i] - p[i];
            for j in 0..=i {
                quadric.a[i * (i + 1) / 2 + j] = f64::from(u8::from(i == j)) - e1[i] * e1[j] - e2[i] * e2[j];
            }
        }
        quadric.c.is_finite().then_some(quadric)
    }

    /// weight · (n·x + d)² for the first three coordinates x, with unit normal n.
    pub fn of_plane(normal: glam::DVec3, offset: f64, weight: f64) -> Self {
        let mut quadric = Self { c: weight * offset * offset, ..Self::default() };
        for i in 0..3 {
            quadric.b[i] = weight * offset * normal[i];
            for j in 0..=i {
                quadric.a[i * (i + 1) / 2 + j] = weight * normal[i] * normal[j];
            }
        }
        quadric
    }

    /// Value at v.
    #[inline]
    pub fn at(&self, v: &[f64; N]) -> f64 {
        let mut sum = self.c;
        for i in 0..N {
            let row = i * (i + 1) / 2;
            let mut half = self.b[i];
            for (a, x) in self.a[row..row + i].iter().zip(v) {
                half += a * x;
            }
            sum += v[i] * (2.0 * half + self.a[row + i] * v[i]);
        }
        sum
    }

    /// Minimiser; `None` if A is singular.
    pub fn minimum(&self) -> Option<[f64; N]> {
        let mut matrix = SMatrix::<f64, N, N>::zeros();
        let mut trace = 0.0;
        for i in 0..N {
            for j in 0..=i {
                matrix[(i, j)] = self.a[i * (i + 1) / 2 + j];
            }
            trace += matrix[(i, i)];
        }
        let cholesky = Cholesky::new(matrix)?;
        let factor = cholesky.l_dirty();
        if (0..N).any(|i| factor[(i, i)] * factor[(i, i)] <= PIVOT_SHARE * trace) {
            return None;
        }
        let mut v = SVector::<f64, N>::from_fn(|i, _| -self.b[i]);
        cholesky.solve_mut(&mut v);
        v.iter().all(|x| x.is_finite()).then(|| v.into())
    }
}

impl<const N: usize, const M: usize> std::ops::AddAssign for WideQuadric<N, M> {
    #[inline]
    fn add_assign(&mut self, other: Self) {
        (0..M).for_each(|i| self.a[i] += other.a[i]);
        (0..N).for_each(|i| self.b[i] += other.b[i]);
        self.c += other.c;
    }
}

impl<const N: usize, const M: usize> std::ops::Add for WideQuadric<N, M> {
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

    type Five = WideQuadric<5, 15>;

    #[test]
    fn its_value_is_the_squared_distance_to_the_plane() {
        // The plane of the first two axes: a point off it by (3, 4, 12) along the other axes has distance 13.
        let quadric = Five::of_triangle([[0.0; 5], [2.0, 0.0, 0.0, 0.0, 0.0], [1.0, 5.0, 0.0, 0.0, 0.0]]).unwrap();
        assert!((quadric.at(&[7.0, -8.0, 3.0, 4.0, 12.0]) - 169.0).abs() < 1e-12);
    }

    #[test]
    fn one_plane_has_no_single_minimum_and_two_crossed_ones_in_four_dimensions_have() {
        let plane = |a: usize, b: usize| {
            let mut corners = [[1.0, 2.0, 3.0, 4.0]; 3];
            corners[1][a] += 1.0;
            corners[2][b] += 1.0;
            WideQuadric::<4, 10>::of_triangle(corners).unwrap()
        };
        assert_eq!(plane(0, 1).minimum(), None);
        let meet = (plane(0, 1) + plane(2, 3)).minimum().unwrap();
        for (found, wanted) in meet.iter().zip([1.0, 2.0, 3.0, 4.0]) {
            assert!((found - wanted).abs() < 1e-12, "{meet:?}");
        }
    }

    #[test]
    fn triangles_without_a_plane_have_no_quadric() {
        assert_eq!(Five::of_triangle([[1.0; 5]; 3]), None);
        assert_eq!(Five::of_triangle([[0.0; 5], [1.0; 5], [2.0; 5]]), None);
    }
}

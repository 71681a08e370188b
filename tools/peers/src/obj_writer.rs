//! [`Mesh`] in, OBJ out: fixed decimals written digit by digit into blocks of 1 MiB.
//!
//! Wedges of one place share a `v` line (meshoptimizer moves them together), every wedge has its own `vt` line, and
//! `usemtl` stands where the material changes; the triangles keep their order, so a material stays in one piece if it
//! was.
//!
//! # Memory
//! 4 bytes a place and 4 a wedge of the input.

use std::fs::File;
use std::io::Write;
use std::path::Path;

use crate::mesh::Mesh;

const BLOCK_BYTES: usize = 1 << 20;
/// Room for the longest line: a face with six indices of ten digits.
const LINE_BYTES: usize = 128;
/// A 400000-pixel texture is told apart.
const TEXCOORD_DECIMALS: usize = 7;

/// Writes the triangles of the mesh and the vertices that they use.
pub fn write_obj(path: &Path, mesh: &Mesh, mtllibs: &[String]) -> std::io::Result<()> {
    let mut out = Block { file: File::create(path)?, bytes: Vec::with_capacity(BLOCK_BYTES + LINE_BYTES) };
    for mtllib in mtllibs {
        writeln!(out.file, "mtllib {mtllib}")?;
    }
    let mut line_of_place = vec![0u32; mesh.place_count];
    let mut line_of_wedge = vec![0u32; mesh.positions.len()];
    for &wedge in &mesh.indices {
        line_of_wedge[wedge as usize] = 1;
    }

    let decimals = position_decimals(mesh);
    let (mut place_count, mut wedge_count) = (0, 0);
    for wedge in 0..mesh.positions.len() {
        if line_of_wedge[wedge] == 0 {
            continue;
        }
        let line = &mut line_of_place[mesh.place_of[wedge] as usize];
        if *line == 0 {
            place_count += 1;
            *line = place_count;
            out.bytes.push(b'v');
            for axis in 0..3 {
                out.number(f64::from(mesh.positions[wedge][axis]) + mesh.origin[axis], decimals);
            }
            out.end_line()?;
        }
        wedge_count += 1;
        line_of_wedge[wedge] = wedge_count;
        if !mesh.texcoords.is_empty() {
            out.bytes.extend(b"vt");
            out.number(f64::from(mesh.texcoords[wedge][0]), TEXCOORD_DECIMALS);
            out.number(f64::from(mesh.texcoords[wedge][1]), TEXCOORD_DECIMALS);
            out.end_line()?;
        }
    }

    let mut material = 0;
    for face in mesh.indices.chunks_exact(3) {
        let own = mesh.material_of[face[0] as usize];
        if own != material {
            material = own;
            out.bytes.extend(b"usemtl ");
            out.bytes.extend(mesh.materials[own as usize].as_bytes());
            out.end_line()?;
        }
        out.bytes.push(b'f');
        for &wedge in face {
            out.bytes.push(b' ');
            out.integer(u64::from(line_of_place[mesh.place_of[wedge as usize] as usize]));
            if !mesh.texcoords.is_empty() {
                out.bytes.push(b'/');
                out.integer(u64::from(line_of_wedge[wedge as usize]));
            }
        }
        out.end_line()?;
    }
    out.file.write_all(&out.bytes)
}

/// Decimals that tell apart what `f32` tells apart at the mesh's extent: 4 for a city of 400 m, 9 for a cup.
fn position_decimals(mesh: &Mesh) -> usize {
    let extent = mesh.positions.iter().flatten().fold(0.0f32, |largest, value| largest.max(value.abs()));
    let step = f64::from(extent.max(1e-9)) * f64::from(f32::EPSILON);
    (-step.log10()).round().clamp(0.0, 12.0) as usize
}

struct Block {
    file: File,
    bytes: Vec<u8>,
}

impl Block {
    fn end_line(&mut self) -> std::io::Result<()> {
        self.bytes.push(b'\n');
        if self.bytes.len() >= BLOCK_BYTES {
            self.file.write_all(&self.bytes)?;
            self.bytes.clear();
        }
        Ok(())
    }

    fn integer(&mut self, mut number: u64) {
        let mut digits = [0u8; 20];
        let mut at = digits.len();
        loop {
            at -= 1;
            digits[at] = b'0' + (number % 10) as u8;
            number /= 10;
            if number == 0 {
                break;
            }
        }
        self.bytes.extend_from_slice(&digits[at..]);
    }

    /// A blank and the number.
    fn number(&mut self, number: f64, decimals: usize) {
        self.bytes.push(b' ');
        let scale = 10u64.pow(decimals as u32);
        let scaled = (number.abs() * scale as f64).round() as u64;
        if number < 0.0 && scaled > 0 {
            self.bytes.push(b'-');
        }
        self.integer(scaled / scale);
        if decimals == 0 {
            return;
        }
        self.bytes.push(b'.');
        let start = self.bytes.len();
        self.bytes.resize(start + decimals, b'0');
        let mut fraction = scaled % scale;
        for digit in self.bytes[start..].iter_mut().rev() {
            *digit = b'0' + (fraction % 10) as u8;
            fraction /= 10;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_sign_and_leading_zeros_of_the_fraction() {
        let mut out = Block { file: File::open("/dev/null").unwrap(), bytes: Vec::new() };
        out.number(-0.0625, 4);
        out.number(432_100.5, 2);
        out.number(-0.001, 2);
        assert_eq!(String::from_utf8(out.bytes).unwrap(), " -0.0625 432100.50 0.00");
    }
}

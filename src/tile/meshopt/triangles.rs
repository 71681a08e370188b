//! Triangles: mostly by an edge and a vertex that occurred shortly before.
//!
//! ```text
//! 0xe1 │ a byte for each triangle │ more of some triangles │ table of 16 pairs
//!        ╰─ edge among the last 15 │ its third vertex: the next new one, among the last 12, beside the last, explicit
//!        ╰─ 15 │ no such edge: a pair of the table, or a byte of its own: where the second and third vertex are from
//! ```

use super::{DECODED_BYTES_MAX, StreamFault};

/// First byte of a stream.
const HEADER: u8 = 0xe1;
/// Bytes of the table at the end, and entries that codes name.
const TABLE_BYTES: usize = 16;
const TABLE_USED: usize = 14;
/// Edges and vertices that are remembered.
const REMEMBERED: usize = 16;
/// Edges that a code can name.
const EDGES_NAMED: usize = 15;
/// Code of an edge's third vertex: the next new vertex; places below `BEFORE` among the last; one less and one more than
/// the last explicit one; explicit.
const NEXT: u8 = 0;
const BEFORE: u8 = 13;
const AFTER: u8 = 14;
const EXPLICIT: u8 = 15;
/// Code of a triangle without a known edge, whose pair is no entry of the table: its first vertex is new, or explicit.
const FIRST_NEXT: u8 = 0xfe;
const FIRST_EXPLICIT: u8 = 0xff;
/// No vertex.
const NONE: u32 = u32::MAX;

/// What encoder and decoder remember.
struct TriangleMemory {
    edges: [[u32; 2]; REMEMBERED],
    edge_count: usize,
    vertices: [u32; REMEMBERED],
    vertex_count: usize,
    /// The next new vertex.
    next: u32,
    /// The last explicit vertex.
    last: u32,
}

impl TriangleMemory {
    fn new() -> Self {
        Self {
            edges: [[NONE; 2]; REMEMBERED],
            edge_count: 0,
            vertices: [NONE; REMEMBERED],
            vertex_count: 0,
            next: 0,
            last: 0,
        }
    }

    /// The edge that was added `back` edges before the last one.
    fn edge(&self, back: usize) -> [u32; 2] {
        self.edges[self.edge_count.wrapping_sub(back + 1) % REMEMBERED]
    }

    fn vertex(&self, back: usize) -> u32 {
        self.vertices[self.vertex_count.wrapping_sub(back + 1) % REMEMBERED]
    }

    fn find_vertex(&self, vertex: u32) -> Option<u8> {
        (0..REMEMBERED).find(|&back| self.vertex(back) == vertex).map(|back| back as u8)
    }

    fn add_edge(&mut self, edge: [u32; 2]) {
        self.edges[self.edge_count % REMEMBERED] = edge;
        self.edge_count += 1;
    }

    fn add_vertex(&mut self, vertex: u32) {
        self.vertices[self.vertex_count % REMEMBERED] = vertex;
        self.vertex_count += 1;
    }

    fn take_next(&mut self) -> u32 {
        self.next = self.next.wrapping_add(1);
        self.next.wrapping_sub(1)
    }

    /// Remembers a triangle beside a known edge (a, b), with the code of its third vertex.
    fn add_beside(&mut self, [a, b, c]: [u32; 3], third: u8) {
        if third == NEXT || third >= BEFORE {
            self.add_vertex(c);
        }
        self.add_edge([c, b]);
        self.add_edge([a, c]);
    }

    /// Remembers a triangle without a known edge, with the codes of its second and third vertex.
    fn add_alone(&mut self, [a, b, c]: [u32; 3], pair: u8) {
        self.add_vertex(a);
        for (vertex, code) in [(b, pair >> 4), (c, pair & 15)] {
            if code == NEXT || code == EXPLICIT {
                self.add_vertex(vertex);
            }
        }
        [[b, a], [c, b], [a, c]].into_iter().for_each(|edge| self.add_edge(edge));
    }
}

/// Compresses triangles. Few bytes suffice if neighbours follow each other and vertices are numbered by their first use.
pub fn encode_triangles(triangles: &[[u32; 3]]) -> Vec<u8> {
    // The pair (new, new) has to be in the table: on its own it starts the numbers again.
    let (_, counts) = encode_with(triangles, [0; TABLE_BYTES]);
    let has_no_explicit = |pair: &u8| pair >> 4 != EXPLICIT && pair & 15 != EXPLICIT;
    let mut frequent: Vec<u8> = (1..=u8::MAX).filter(has_no_explicit).collect();
    frequent.sort_by_key(|&pair| std::cmp::Reverse(counts[usize::from(pair)]));
    let mut table = [0; TABLE_BYTES];
    table[1..TABLE_USED].copy_from_slice(&frequent[..TABLE_USED - 1]);
    encode_with(triangles, table).0
}

/// Compresses triangles with a table of pairs; returns how often each pair occurred behind a new vertex, too.
fn encode_with(triangles: &[[u32; 3]], table: [u8; TABLE_BYTES]) -> (Vec<u8>, [u32; 256]) {
    let mut memory = TriangleMemory::new();
    let (mut codes, mut more, mut counts) = (vec![HEADER], Vec::new(), [0; 256]);
    for &triangle in triangles {
        if let Some((edge, [a, b, c])) = known_edge(&memory, triangle) {
            let third = match memory.find_vertex(c) {
                Some(back) if (1..BEFORE).contains(&back) => back,
                _ if c == memory.next => NEXT,
                _ if c.wrapping_add(1) == memory.last => BEFORE,
                _ if c == memory.last.wrapping_add(1) => AFTER,
                _ => EXPLICIT,
            };
            codes.push((edge as u8) << 4 | third);
            match third {
                NEXT => _ = memory.take_next(),
                EXPLICIT => put_index(&mut memory, c, &mut more),
                BEFORE | AFTER => memory.last = c,
                _ => {}
            }
            memory.add_beside([a, b, c], third);
            continue;
        }
        let [a, b, c] = new_first(triangle, memory.next);
        let is_new = a == memory.next;
        if is_new {
            memory.take_next();
        }
        let mut code_of = |vertex: u32| match memory.find_vertex(vertex) {
            Some(back) if back < TABLE_USED as u8 => back + 1,
            _ if vertex == memory.next => {
                memory.take_next();
                NEXT
            }
            _ => EXPLICIT,
        };
        let pair = code_of(b) << 4 | code_of(c);
        counts[usize::from(pair)] += u32::from(is_new);
        match table[..TABLE_USED].iter().position(|&entry| entry == pair).filter(|_| is_new) {
            Some(entry) => codes.push(0xf0 | entry as u8),
            None => {
                codes.push(if is_new { FIRST_NEXT } else { FIRST_EXPLICIT });
                more.push(pair);
            }
        }
        if !is_new {
            put_index(&mut memory, a, &mut more);
        }
        for (vertex, code) in [(b, pair >> 4), (c, pair & 15)] {
            if code == EXPLICIT {
                put_index(&mut memory, vertex, &mut more);
            }
        }
        memory.add_alone([a, b, c], pair);
    }
    codes.append(&mut more);
    codes.extend(table);
    (codes, counts)
}

/// A triangle turned so that its first two vertices are a known edge, and how far back that edge is.
fn known_edge(memory: &TriangleMemory, triangle: [u32; 3]) -> Option<(usize, [u32; 3])> {
    let turns = turns_of(triangle);
    let find = |back: usize| {
        let edge = memory.edge(back);
        turns.into_iter().find(|turned| turned[..2] == edge).map(|turned| (back, turned))
    };
    (0..EDGES_NAMED).find_map(find)
}

fn turns_of([a, b, c]: [u32; 3]) -> [[u32; 3]; 3] {
    [[a, b, c], [b, c, a], [c, a, b]]
}

/// A triangle turned so that the next new vertex comes first, if it is one of its vertices.
fn new_first(triangle: [u32; 3], next: u32) -> [u32; 3] {
    turns_of(triangle).into_iter().find(|turned| turned[0] == next).unwrap_or(triangle)
}

/// Adds an explicit vertex: its difference from the last one, 7 bits a byte.
fn put_index(memory: &mut TriangleMemory, vertex: u32, out: &mut Vec<u8>) {
    let difference = vertex.wrapping_sub(memory.last);
    let mut rest = if difference >> 31 == 0 { difference << 1 } else { !(difference << 1) };
    while rest >= 0x80 {
        out.push(rest as u8 | 0x80);
        rest >>= 7;
    }
    out.push(rest as u8);
    memory.last = vertex;
}

/// What a decoder has not read yet.
struct TriangleReader<'a> {
    memory: TriangleMemory,
    more: std::slice::Iter<'a, u8>,
}

/// Decodes `count` triangles. Nothing larger than 12 times the stream is allocated. The vertices may be any numbers.
///
/// # Errors
/// What is wrong with the stream.
pub fn decode_triangles(stream: &[u8], count: usize) -> Result<Vec<[u32; 3]>, StreamFault> {
    let body = stream.split_first().filter(|(header, _)| **header == HEADER).map(|(_, body)| body);
    let body = body.ok_or("its triangles have another header")?;
    let (body, table) = body.split_last_chunk::<TABLE_BYTES>().ok_or("its triangles end too early")?;
    let parts = body.split_at_checked(count).filter(|_| count <= DECODED_BYTES_MAX / 12);
    let (codes, more) = parts.ok_or("it names more triangles than it holds")?;
    let mut reader = TriangleReader { memory: TriangleMemory::new(), more: more.iter() };
    let triangles = codes.iter().map(|&code| reader.triangle(code, table)).collect::<Result<_, _>>()?;
    if reader.more.len() == 0 { Ok(triangles) } else { Err("bytes follow its triangles") }
}

impl TriangleReader<'_> {
    fn triangle(&mut self, code: u8, table: &[u8; TABLE_BYTES]) -> Result<[u32; 3], StreamFault> {
        if code < 0xf0 {
            let ([a, b], third) = (self.memory.edge(usize::from(code >> 4)), code & 15);
            let c = match third {
                NEXT => self.memory.take_next(),
                EXPLICIT => self.index()?,
                BEFORE | AFTER => {
                    let away = if third == BEFORE { u32::MAX } else { 1 };
                    self.memory.last = self.memory.last.wrapping_add(away);
                    self.memory.last
                }
                back => self.memory.vertex(usize::from(back)),
            };
            self.memory.add_beside([a, b, c], third);
            return Ok([a, b, c]);
        }
        let pair = if code < FIRST_NEXT { table[usize::from(code & 15)] } else { self.byte()? };
        if code >= FIRST_NEXT && pair == 0 {
            self.memory.next = 0;
        }
        // New vertices are numbered first, explicit ones are read afterwards.
        let is_explicit = [code == FIRST_EXPLICIT, pair >> 4 == EXPLICIT, pair & 15 == EXPLICIT];
        let mut corners = [NONE; 3];
        if !is_explicit[0] {
            corners[0] = self.memory.take_next();
        }
        for (corner, place) in [(1, pair >> 4), (2, pair & 15)] {
            corners[corner] = match place {
                NEXT => self.memory.take_next(),
                EXPLICIT => NONE,
                place => self.memory.vertex(usize::from(place) - 1),
            };
        }
        for (corner, _) in is_explicit.into_iter().enumerate().filter(|(_, is_explicit)| *is_explicit) {
            corners[corner] = self.index()?;
        }
        self.memory.add_alone(corners, pair);
        Ok(corners)
    }

    fn byte(&mut self) -> Result<u8, StreamFault> {
        self.more.next().copied().ok_or("its triangles end too early")
    }

    /// An explicit vertex.
    fn index(&mut self) -> Result<u32, StreamFault> {
        let mut number = 0_u32;
        for shift in [0, 7, 14, 21, 28] {
            let byte = self.byte()?;
            number |= u32::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                let difference = if number & 1 == 0 { number >> 1 } else { !(number >> 1) };
                self.memory.last = self.memory.last.wrapping_add(difference);
                return Ok(self.memory.last);
            }
        }
        Err("a vertex of a triangle is too large a number")
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// A triangle with its least vertex first.
    fn turned(triangle: [u32; 3]) -> [u32; 3] {
        turns_of(triangle).into_iter().min().unwrap()
    }

    fn round_trip(triangles: &[[u32; 3]]) -> usize {
        let stream = encode_triangles(triangles);
        let found = decode_triangles(&stream, triangles.len()).unwrap();
        let turned_all = |list: &[[u32; 3]]| list.iter().copied().map(turned).collect::<Vec<_>>();
        assert_eq!(turned_all(&found), turned_all(triangles));
        stream.len()
    }

    #[test]
    fn a_strip_takes_a_byte_a_triangle() {
        // 0─2─4─…
        // │╱│╱│
        // 1─3─5─…
        let pair = |at: u32| [[at, at + 1, at + 2], [at + 2, at + 1, at + 3]];
        let strip: Vec<[u32; 3]> = (0..1000).step_by(2).flat_map(pair).collect();
        assert_eq!(round_trip(&strip), 1 + strip.len() + TABLE_BYTES);
    }

    #[test]
    fn numbers_that_start_again_are_kept() {
        round_trip(&[
            [0, 1, 2],
            [2, 1, 3],
            [0, 1, 2],
            [2, 1, 5],
            [2, 1, 4],
            [0, 1, 2],
            [7, 0, 1],
            [u32::MAX - 1, 0, 9],
        ]);
        assert_eq!(round_trip(&[]), 1 + TABLE_BYTES);
    }

    #[test]
    fn a_number_that_the_stream_does_not_hold_is_refused_before_anything_is_allocated() {
        let stream = encode_triangles(&[[0, 1, 2]]);
        for count in [0, 2, 1 << 40, usize::MAX] {
            assert!(decode_triangles(&stream, count).is_err(), "{count}");
        }
    }

    proptest! {
        #[test]
        fn triangles_are_read_as_they_were_written(
            most in prop::sample::select(vec![3_u32, 12, 60, 70_000, u32::MAX]),
            corners in prop::collection::vec(any::<[u32; 3]>(), 0..300),
        ) {
            let triangles: Vec<[u32; 3]> = corners.iter().map(|all| all.map(|corner| corner % most)).collect();
            round_trip(&triangles);
        }

        #[test]
        fn damaged_streams_are_refused_or_read(
            changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            cut in any::<prop::sample::Index>(),
        ) {
            let triangles: Vec<[u32; 3]> = (0..90).map(|at| [at, at * at % 50, at + 2]).collect();
            let mut stream = encode_triangles(&triangles);
            for (at, byte) in changes {
                let at = at.index(stream.len());
                stream[at] = byte;
            }
            let _ = decode_triangles(&stream, triangles.len());
            stream.truncate(cut.index(stream.len()));
            let _ = decode_triangles(&stream, triangles.len());
        }
    }
}

//! Reads a tile's GLB back: structure, places on the lattice, triangles, skirt, texture.
//!
//! Every byte is hostile: a file is refused with words, and what is allocated is bounded by its size, and by that of an
//! image.

use glam::{DVec3, IVec3};
use serde_json::Value;

use super::reader::{ContentFault, GlbReader, TileFault, chunks, number};
use super::texture::{TileTexture, texture_of};
use crate::geometry::triangle::area;
use crate::write::glb_format::Z_TO_Y;

/// Share by which a coordinate may be off its place on the lattice.
const ROUNDING: f64 = 1e-15;
/// Mode of a primitive of triangles.
const TRIANGLES: u64 = 4;

/// Attributes of vertices whose counts are compared.
const ATTRIBUTES_MAX: usize = 16;

/// What was read of a GLB.
#[derive(Debug, Default)]
pub struct ReadTile {
    /// Step of the lattice in each direction.
    pub step: f64,
    /// Places of the vertices on the lattice of the scene; z points up.
    pub places: Vec<[i64; 3]>,
    /// Vertices of each triangle.
    pub triangles: Vec<[u32; 3]>,
    /// Triangles of the skirt, which come last.
    pub skirt_triangles: usize,
    /// Its texture; `None` if it has none.
    pub texture: Option<TileTexture>,
    /// What is wrong with it.
    pub faults: Vec<TileFault>,
}

impl ReadTile {
    /// Triangles without those of the skirt.
    pub fn surface(&self) -> &[[u32; 3]] {
        &self.triangles[..self.triangles.len() - self.skirt_triangles]
    }

    /// Triangles of the surface with the same vertices, in the same order, as another one.
    pub fn duplicate_triangles(&self) -> u64 {
        let mut all: Vec<[u32; 3]> = self.surface().to_vec();
        for triangle in &mut all {
            let least = (0..3).min_by_key(|&corner| triangle[corner]).unwrap_or(0);
            triangle.rotate_left(least);
        }
        all.sort_unstable();
        all.windows(2).filter(|pair| pair[0] == pair[1]).count() as u64
    }

    /// Area of the surface, in the mesh's unit of length.
    pub fn area(&self) -> f64 {
        let position = |vertex: u32| DVec3::from(self.places[vertex as usize].map(|at| at as f64));
        self.surface().iter().map(|triangle| area(triangle.map(position))).sum::<f64>() * self.step * self.step
    }
}

/// Reads a GLB.
///
/// # Errors
/// What is wrong with it, if it cannot be read.
pub fn read_glb(bytes: &[u8]) -> Result<ReadTile, ContentFault> {
    let (json, chunk) = chunks(bytes)?;
    let document: Value = serde_json::from_slice(json).map_err(|error| format!("its JSON: {error}"))?;
    let reader = GlbReader { document: &document, chunk };
    check_scene(&document)?;
    let (step, shift) = lattice_of(&document["nodes"][0])?;
    let mesh = &document["meshes"][0];
    let primitive = &mesh["primitives"][0];
    if let Some(mode) = primitive.get("mode").filter(|mode| mode.as_u64() != Some(TRIANGLES)) {
        return Err(format!("a primitive of mode {mode}, not of triangles"));
    }
    let attributes = &primitive["attributes"];
    let own = reader.positions(&attributes["POSITION"])?;
    let mut faults = Vec::new();
    check_accessors(&reader, primitive, &own, |words| faults.push(TileFault { kind: "accessor", words }));
    let places = own.into_iter().map(|place| [0, 1, 2].map(|axis| i64::from(place[axis]) + shift[axis]));
    let places: Vec<[i64; 3]> = places.collect();
    let triangles = reader.triangles(&primitive["indices"], places.len())?;
    let skirt_triangles = mesh["extras"]["skirtTriangles"].as_u64().unwrap_or(0);
    let skirt_triangles = usize::try_from(skirt_triangles).ok().filter(|&count| count <= triangles.len());
    let skirt_triangles = skirt_triangles.ok_or("it has fewer triangles than its skirt")?;
    let texture = texture_of(&reader, primitive, &mut faults);
    Ok(ReadTile { step, places, triangles, skirt_triangles, texture, faults })
}

/// Checks that there is one node with one mesh of one primitive, which the scene shows.
fn check_scene(document: &Value) -> Result<(), ContentFault> {
    let count = |value: &Value| value.as_array().map_or(0, Vec::len);
    let counts = [&document["nodes"], &document["meshes"], &document["meshes"][0]["primitives"]].map(count);
    let scene = document["scene"].as_u64().map(|scene| &document["scenes"][scene as usize]["nodes"]);
    let is_shown = scene.is_some_and(|nodes| count(nodes) == 1 && nodes[0] == 0) && document["nodes"][0]["mesh"] == 0;
    if counts == [1; 3] && is_shown { Ok(()) } else { Err("expected a scene of one mesh with one primitive".into()) }
}

/// The step of the lattice of a node, and the place that it moves its mesh to; z points up.
fn lattice_of(node: &Value) -> Result<(f64, [i64; 3]), ContentFault> {
    let step = number(&node["scale"][0]).ok_or("its node has no scale")?;
    let translation = [0, 1, 2].map(|axis| number(&node["translation"][axis]));
    let [Some(x), Some(up), Some(south)] = translation else { return Err("its node has no translation".into()) };
    if !(step.is_normal() && step > 0.0) || [1, 2].iter().any(|&axis| number(&node["scale"][axis]) != Some(step)) {
        return Err(format!("the scale of its node is {}", node["scale"]));
    }
    if [0, 1, 2, 3].iter().any(|&at| number(&node["rotation"][at]) != Some(Z_TO_Y[at])) || node.get("matrix").is_some()
    {
        return Err("its node does not turn z up to y up".into());
    }
    let middle = DVec3::new(x, -south, up) / step;
    // The product of place and step is rounded, and so is the quotient.
    let is_place = (middle.round() - middle).abs().cmple(ROUNDING * middle.abs()).all();
    if !is_place || !middle.is_finite() || middle.abs().max_element() > 1e15 {
        return Err("its translation is no place of the lattice".into());
    }
    Ok((step, middle.round().to_array().map(|at| at as i64)))
}

/// Checks the types, counts and bounds of the accessors of a primitive; `fault` gets what is wrong, in words.
fn check_accessors(
    reader: &GlbReader<'_>,
    primitive: &Value,
    positions: &[IVec3],
    mut fault: impl FnMut(ContentFault),
) {
    let attributes = primitive["attributes"].as_object();
    for (name, accessor) in attributes.into_iter().flatten().take(ATTRIBUTES_MAX) {
        let accessor = reader.accessor(accessor);
        if accessor["count"] != positions.len() {
            fault(format!("{name} has {} elements, POSITION {}", accessor["count"], positions.len()));
        }
    }
    let types = [("POSITION", "VEC3"), ("TEXCOORD_0", "VEC2"), ("indices", "SCALAR")];
    for (name, expected) in types {
        let accessor = if name == "indices" { &primitive[name] } else { &primitive["attributes"][name] };
        let found = &reader.accessor(accessor)["type"];
        if !accessor.is_null() && found != expected {
            fault(format!("{name} is of type {found}, expected {expected}"));
        }
    }
    let accessor = reader.accessor(&primitive["attributes"]["POSITION"]);
    let lowest = positions.iter().copied().reduce(IVec3::min).unwrap_or_default();
    let highest = positions.iter().copied().reduce(IVec3::max).unwrap_or_default();
    for (bound, expected) in [("min", lowest), ("max", highest)] {
        let found = accessor[bound].as_array().map(|all| all.iter().map(number).collect::<Vec<_>>());
        if found.as_deref() != Some(&expected.as_dvec3().to_array().map(Some)) {
            fault(format!("{bound} of POSITION is {}, expected {:?}", accessor[bound], expected.to_array()));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::encode::encode_in_memory;
    use crate::model::image_format::ImageFormat;
    use crate::tile::glb::{TileContent, TileVertex};
    use glam::DVec2;
    use proptest::prelude::*;
    use serde_json::json;

    fn content() -> TileContent {
        let vertex = |place| TileVertex { place, texcoord: DVec2::ZERO };
        TileContent {
            vertices: [IVec3::ZERO, IVec3::X, IVec3::new(-40, 7, 3000)].map(vertex).to_vec(),
            triangles: vec![[0, 1, 2]],
            step: 0.25,
            middle: DVec3::new(1.0, -2.0, 3.5),
            ..TileContent::default()
        }
    }

    fn glb(is_compressed: bool) -> Vec<u8> {
        content().to_glb(is_compressed)
    }

    /// A tile with an image of 16 x 8 texels, all of which its triangle would show if it were twice as large.
    fn textured(format: ImageFormat) -> Vec<u8> {
        let image = encode_in_memory(&[90; 3 * 16 * 8], [16, 8], format, "grey").unwrap();
        let mut content = TileContent { image: Some((image, format)), ..content() };
        content.vertices[1].texcoord = DVec2::X;
        content.vertices[2].texcoord = DVec2::Y;
        content.to_glb(false)
    }

    /// A GLB with a changed document and binary chunk.
    fn changed(glb: &[u8], change: impl FnOnce(&mut Value, &mut Vec<u8>)) -> Vec<u8> {
        let (json, chunk) = chunks(glb).unwrap();
        let (mut document, mut chunk) = (serde_json::from_slice(json).unwrap(), chunk.to_vec());
        change(&mut document, &mut chunk);
        let json = document.to_string().into_bytes();
        let mut file = b"glTF".to_vec();
        let total = 28 + json.len() + chunk.len();
        [2, total as u32, json.len() as u32].iter().for_each(|word| file.extend(word.to_le_bytes()));
        [b"JSON".to_vec(), json, (chunk.len() as u32).to_le_bytes().to_vec(), b"BIN\0".to_vec(), chunk]
            .iter()
            .for_each(|part| file.extend(part));
        file
    }

    /// What is wrong with a tile with an image after a change of its document: kinds and words.
    fn found(change: impl FnOnce(&mut Value)) -> String {
        match read_glb(&changed(&textured(ImageFormat::Png), |document, _| change(document))) {
            Ok(read) => read.faults.iter().map(|fault| format!("{}: {}\n", fault.kind, fault.words)).collect(),
            Err(words) => format!("content: {words}"),
        }
    }

    #[test]
    fn a_tile_with_an_image_has_no_fault() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg(80)] {
            let read = read_glb(&textured(format)).unwrap();
            assert_eq!(read.faults, []);
            let texture = read.texture.as_ref().unwrap();
            assert_eq!((texture.size, texture.texels(read.surface())), ([16, 8], 64.0));
            assert!(texture.image_bytes > 60);
        }
        assert_eq!(read_glb(&glb(true)).unwrap().faults, []);
    }

    #[test]
    fn accessors_that_do_not_fit_their_data_are_found() {
        for (bound, value) in [("min", json!([-41, 0, 0])), ("max", json!([1, 7, 2999])), ("max", json!([1, 7, 3001]))]
        {
            assert!(found(|document| document["accessors"][0][bound] = value).starts_with("accessor: "), "{bound}");
        }
        for missing in [Value::Null, json!([-40, 0]), json!([-40, 0, "0"])] {
            assert!(found(|document| document["accessors"][0]["min"] = missing).contains("min of POSITION"));
        }
        let words = found(|document| document["accessors"][2]["count"] = 2.into());
        assert!(words.contains("TEXCOORD_0 has 2 elements, POSITION 3"), "{words}");
        assert!(found(|document| document["accessors"][2]["count"] = 4.into()).contains("beyond its buffer view"));
        assert!(found(|document| document["accessors"][2]["componentType"] = 5126.into()).contains("accessor: "));
        assert!(found(|document| document["accessors"][0]["type"] = "VEC2".into()).contains("expected VEC3"));
    }

    #[test]
    fn a_primitive_of_lines_and_a_scene_of_several_meshes_are_refused() {
        assert!(found(|document| document["meshes"][0]["primitives"][0]["mode"] = 1.into()).contains("mode 1"));
        assert_eq!(found(|document| document["meshes"][0]["primitives"][0]["mode"] = 4.into()), "");
        let twice = |list: &mut Value| {
            let first = list[0].clone();
            list.as_array_mut().unwrap().push(first);
        };
        for list in ["nodes", "meshes"] {
            assert!(found(|document| twice(&mut document[list])).contains("one mesh"), "{list}");
        }
        assert!(found(|document| twice(&mut document["meshes"][0]["primitives"])).contains("one mesh"));
        assert!(found(|document| document["scenes"][0]["nodes"] = json!([])).contains("one mesh"));
        assert!(found(|document| document["nodes"][0]["scale"][1] = 2.into()).contains("scale"));
        assert!(found(|document| document["nodes"][0]["rotation"][0] = 0.into()).contains("turn"));
    }

    #[test]
    fn textures_that_are_missing_are_found() {
        type Change = fn(&mut Value);
        let missing: [(Change, &str); 6] = [
            (|document| document["materials"][0]["pbrMetallicRoughness"] = json!({}), "its material no texture"),
            (|document| document["meshes"][0]["primitives"][0]["material"] = Value::Null, "no material"),
            (|document| document["materials"] = json!([]), "materials that is missing"),
            (|document| document["textures"] = json!([]), "textures that is missing"),
            (|document| document["images"] = json!([]), "images that is missing"),
            (
                |document| {
                    _ = document["meshes"][0]["primitives"][0]["attributes"]
                        .as_object_mut()
                        .unwrap()
                        .remove("TEXCOORD_0")
                },
                "no texture coordinates",
            ),
        ];
        for (change, words) in missing {
            let found = found(change);
            assert!(found.starts_with("texture: ") && found.contains(words), "{found}");
        }
    }

    #[test]
    fn damaged_images_are_found() {
        let (png, jpeg) = (textured(ImageFormat::Png), textured(ImageFormat::Jpeg(80)));
        let faults = |glb: &[u8]| read_glb(glb).unwrap().faults;
        for glb in [png, jpeg] {
            let view = |document: &Value| {
                ["byteOffset", "byteLength"].map(|key| document["bufferViews"][2][key].as_u64().unwrap() as usize)
            };
            let halved =
                changed(&glb, |document, _| document["bufferViews"][2]["byteLength"] = (view(document)[1] / 2).into());
            let headless = changed(&glb, |document, chunk| chunk[view(document)[0]..][..8].fill(0));
            let empty = changed(&glb, |document, chunk| {
                let [start, length] = view(document);
                chunk[start + length / 2..start + length].fill(0);
            });
            let typeless = changed(&glb, |document, _| document["images"][0]["mimeType"] = Value::Null);
            let elsewhere = changed(&glb, |document, _| document["images"][0]["bufferView"] = Value::Null);
            for damaged in [halved, headless, empty, typeless, elsewhere] {
                let found = faults(&damaged);
                assert!(found.len() == 1 && found[0].kind == "image", "{found:?}");
            }
        }
    }

    #[test]
    fn a_triangle_that_is_there_twice_is_counted() {
        let mut content = content();
        content.vertices.push(TileVertex { place: IVec3::Y, texcoord: DVec2::ZERO });
        // The back of a triangle is another one; one of a skirt is not looked at.
        content.triangles = vec![[0, 1, 2], [1, 3, 2], [2, 1, 0], [2, 0, 1], [1, 3, 2], [0, 1, 2], [0, 1, 2]];
        content.skirt_triangles = 2;
        assert_eq!(read_glb(&content.to_glb(false)).unwrap().duplicate_triangles(), 2);
    }

    #[test]
    fn a_tile_is_read_as_it_was_written() {
        for is_compressed in [false, true] {
            let read = read_glb(&glb(is_compressed)).unwrap();
            assert_eq!(read.places, [[4, -8, 14], [5, -8, 14], [-36, -1, 3014]]);
            assert_eq!((read.step, read.triangles, read.skirt_triangles), (0.25, vec![[0, 1, 2]], 0));
        }
    }

    proptest! {
        #[test]
        fn a_tile_far_from_the_origin_is_read_as_it_was_written(place in prop::array::uniform3(-1i32 << 29..1 << 29), far in 0..1i32 << 30, exponent in -40i32..20) {
            let step = f64::from(exponent).exp2();
            let corners = [IVec3::ZERO, IVec3::X, IVec3::new(-40, far, 3000)];
            let vertices = corners.map(|place| TileVertex { place, texcoord: DVec2::ZERO }).to_vec();
            let middle = IVec3::from(place).as_dvec3() * step;
            let mut content = TileContent { vertices, triangles: vec![[0, 1, 2]], step, middle, ..TileContent::default() };
            content.settle();
            let read = read_glb(&content.to_glb(false)).unwrap();
            let moved = i64::from(far) - (read.places[2][1] - i64::from(place[1]));
            prop_assert!(moved.abs() <= i64::from(far >> 24), "{moved}");
            prop_assert_eq!(read.places[0], place.map(i64::from));
        }

        #[test]
        fn damaged_files_are_refused_or_read(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>(), is_compressed in any::<bool>()) {
            for mut bytes in [glb(is_compressed), textured(ImageFormat::Png)] {
                for (at, byte) in &changes {
                    let at = at.index(bytes.len());
                    bytes[at] = *byte;
                }
                let look = |read: ReadTile| (read.area(), read.duplicate_triangles(), read.texture.as_ref().map(|own| own.texels(read.surface())));
                let _ = read_glb(&bytes).map(look);
                bytes.truncate(cut.index(bytes.len()));
                let _ = read_glb(&bytes).map(look);
            }
        }
    }
}

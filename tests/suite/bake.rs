//! New textures: what a result shows, whatever its input was coloured by, and the same bytes however the job ran.

use std::fs;
use std::path::Path;

use drystone::measure::compare::{CompareOptions, Comparison, Resources, Spread, compare};
use drystone::options::{
    ImageFormat, JobOptions, Limits, ResumeChoice, SimplifyOptions, TextureFiles, TexturesOutside, TileOptions,
};
use drystone::{Error, ErrorKind, Progress, Silent, pipeline, plan};

use crate::meshes::{Run, StopAfter, contents, copy_town, in_many_clusters, ratio, simplify, status, town};

fn baked(options: SimplifyOptions) -> SimplifyOptions {
    SimplifyOptions { textures: TextureFiles::Bake, ..options }
}

pub fn compared(input: &Path, output: &Path) -> Comparison {
    let folder = tempfile::tempdir().unwrap();
    let resources = Resources { threads: 2, work_bytes: 64 << 20, scan: Default::default() };
    let work = folder.path().join("work");
    let options = CompareOptions { spread: Spread::Area(50_000), seed: 1, texel: None, work, resources };
    compare(input, output, &options, &mut (), &Silent).unwrap()
}

/// A row of squares one unit wide along the first axis, each with its own statements before its faces; `uv` are the
/// texture coordinates of the four corners of the square at a place.
fn row(squares: &[&str], colours: &[&str], uv: [[f64; 2]; 4]) -> String {
    row_of_parts(squares, colours, &vec![uv; squares.len()])
}

/// The same, each square with texture coordinates of its own.
fn row_of_parts(squares: &[&str], colours: &[&str], parts: &[[[f64; 2]; 4]]) -> String {
    let mut text = "mtllib a.mtl\n".to_owned();
    for (square, statements) in squares.iter().enumerate() {
        let colour = colours.get(square).copied().unwrap_or("");
        for [x, y] in [[0, 0], [1, 0], [1, 1], [0, 1]] {
            text += &format!("v {} {y} 0 {colour}\n", x + 2 * square);
        }
        for [u, v] in parts[square] {
            text += &format!("vt {u} {v}\n");
        }
        let at = |corner: usize| format!("{0}/{0}", 4 * square + corner);
        text += &format!("{statements}\nf {} {} {} {}\n", at(1), at(2), at(3), at(4));
    }
    text
}

/// A triangle of a baked [`row`]: its square, and its corners in texels from the upper left.
type ShownTriangle = (usize, [[f64; 2]; 3]);

/// The image of a baked [`row`], and the triangles that show it.
fn shown_by_row(folder: &Path) -> (image::RgbImage, Vec<ShownTriangle>) {
    let text = fs::read_to_string(folder.join("out.obj")).unwrap();
    let image = fs::read_dir(folder.join("out_textures")).unwrap().next().unwrap().unwrap().path();
    let image = image::open(image).unwrap().into_rgb8();
    let numbers = |line: &str| line.split(' ').skip(1).map(|word| word.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let of_kind = |kind: &str| text.lines().filter(|line| line.starts_with(kind)).map(numbers).collect::<Vec<_>>();
    let (positions, texcoords) = (of_kind("v "), of_kind("vt "));
    let shown = |line: &str| {
        let mut corners = [[0.0; 2]; 3];
        let mut along = 0.0;
        for (corner, word) in corners.iter_mut().zip(line.split(' ').skip(1)) {
            let ids: Vec<usize> = word.split('/').map(|id| id.parse::<usize>().unwrap() - 1).collect();
            let [u, v] = [texcoords[ids[1]][0], texcoords[ids[1]][1]];
            *corner = [u * f64::from(image.width()), (1.0 - v) * f64::from(image.height())];
            along += positions[ids[0]][0] / 3.0;
        }
        ((along / 2.0) as usize, corners)
    };
    let triangles = text.lines().filter(|line| line.starts_with("f ")).map(shown).collect();
    (image, triangles)
}

/// Mean colour of the baked texels that show each square of a [`row`].
fn colours_of_row(folder: &Path, squares: usize) -> Vec<[f64; 3]> {
    let (image, triangles) = shown_by_row(folder);
    let mut sums = vec![([0.0; 3], 0.0); squares];
    for (square, corners) in triangles {
        let [x, y] = [0, 1].map(|axis| corners.iter().map(|corner| corner[axis]).sum::<f64>() / 3.0);
        let pixel = image.get_pixel(x as u32, y as u32).0;
        (0..3).for_each(|channel| sums[square].0[channel] += f64::from(pixel[channel]));
        sums[square].1 += 1.0;
    }
    sums.into_iter().map(|(sum, count)| sum.map(|channel| channel / count)).collect()
}

const WHOLE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

/// Bakes a row, and returns the colours of its squares.
fn baked_row(mtl: &str, text: &str, squares: usize) -> Vec<[f64; 3]> {
    colours_of_row(bake_row(mtl, text).folder(), squares)
}

/// Bakes a row.
fn bake_row(mtl: &str, text: &str) -> Run {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    // Left half red, right half blue.
    image::RgbImage::from_fn(64, 64, |x, _| image::Rgb(if x < 32 { [220, 20, 10] } else { [10, 30, 200] }))
        .save(path("halves.png"))
        .unwrap();
    image::RgbImage::from_pixel(32, 32, image::Rgb([40, 160, 60])).save(path("green.png")).unwrap();
    fs::write(path("a.mtl"), mtl).unwrap();
    fs::write(path("bad.png"), "no image").unwrap();
    fs::write(path("in.obj"), text).unwrap();
    simplify(&path("in.obj"), &baked(ratio(1.0)))
}

fn assert_near(found: &[[f64; 3]], expected: &[[f64; 3]]) {
    for (found, expected) in found.iter().zip(expected) {
        assert!((0..3).all(|channel| (found[channel] - expected[channel]).abs() < 4.0), "{found:?}: {expected:?}");
    }
}

#[test]
fn a_town_shows_its_colours_with_fewer_texels_and_no_seam_that_holds_it() {
    let options = in_many_clusters(ratio(0.1));
    let (kept, new) = (simplify(&town(), &options), simplify(&town(), &baked(options)));
    let [kept, new_figures] = [&kept, &new].map(|run| compared(&town(), &run.output));
    let [kept_texture, new_texture] = [&kept, &new_figures].map(|figures| figures.texture.as_ref().unwrap());
    assert!(new_texture.colour_rms < 0.75 * kept_texture.colour_rms, "{new_texture:?} {kept_texture:?}");
    assert!(new_figures.geometry.symmetric.rms <= 1.02 * kept.geometry.symmetric.rms);
    assert_eq!(new_texture.folded_triangles, 0);
    let bake = new.report.bake.unwrap();
    assert!(bake.fill > 0.3 && bake.colourless == 0, "{bake:?}");
}

#[test]
fn threads_memory_and_stops_leave_no_trace_in_baked_files() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    copy_town(&path("in"));
    let run = |to: &str, options: SimplifyOptions, progress: &dyn Progress| {
        fs::create_dir_all(path(to)).unwrap();
        pipeline::simplify(path("in/town.obj"), &path(to).join("out.obj"), &options, progress).map(drop)
    };
    let options = SimplifyOptions { atlas: 512, texels: 0.5, ..baked(in_many_clusters(ratio(0.3))) };
    run("whole", options.clone(), &Silent).unwrap();
    let whole = contents(&path("whole"));
    assert!(whole.len() > 4, "an OBJ, an MTL and several images: {:?}", whole.keys());
    for (threads, mebibytes) in [(1, 128), (4, 1024)] {
        let limits = Limits { threads: Some(threads), memory: Some(mebibytes << 20) };
        run("other", SimplifyOptions { limits, ..options.clone() }, &Silent).unwrap();
        assert!(contents(&path("other")) == whole, "{threads} threads, {mebibytes} MiB");
        fs::remove_dir_all(path("other")).unwrap();
    }
    let (mut stops, mut patches_done) = (0, 0);
    // What is recorded must be intact, once there is something.
    let resumed = |patches_done| {
        let resume = if patches_done > 0 { ResumeChoice::Require } else { ResumeChoice::Auto };
        SimplifyOptions { job: JobOptions { resume, ..options.job.clone() }, ..options.clone() }
    };
    while let Err(error) = run("parts", resumed(patches_done), &StopAfter::units(20 + 5 * stops)) {
        assert!(matches!(error, Error::Stopped) && stops < 1000, "{error}");
        assert!(!path("parts/out.obj").exists());
        stops += 1;
        let bake = &status(&path("parts/out.obj.work"))["bake"];
        let done = bake["patches_done"].as_u64().unwrap_or(0);
        assert!(done >= patches_done && bake["patches"].as_u64().is_none_or(|patches| done <= patches), "{bake}");
        patches_done = done;
    }
    assert!(stops > 3 && patches_done > 1);
    assert!(contents(&path("parts")) == whole);
}

#[test]
fn plain_materials_images_and_their_options_are_baked() {
    let mtl = "newmtl halves\nmap_Kd halves.png\nnewmtl green\nKd 1 0 0\nmap_Kd green.png\n\
               newmtl plain\nKd 0.2 0.4 0.6\nnewmtl moved\nmap_Kd -S 0.5 1 1 -o 0.5 0 0 halves.png\n";
    let text = row(&["usemtl green", "usemtl plain", "usemtl moved"], &[], WHOLE);
    let expected = [[40.0, 160.0, 60.0], [51.0, 102.0, 153.0], [10.0, 30.0, 200.0]];
    assert_near(&baked_row(mtl, &text, 3), &expected);
}

#[test]
fn an_image_that_repeats_is_read_at_each_place() {
    let mtl = "newmtl halves\nmap_Kd halves.png\n";
    // A quarter of the image, in its second repeat: red.
    let second = [[7.1, -3.0], [7.4, -3.0], [7.4, -2.5], [7.1, -2.5]];
    assert_near(&baked_row(mtl, &row(&["usemtl halves"], &[], second), 1), &[[220.0, 20.0, 10.0]]);
    // From the middle of one repeat to the middle of the next: blue, then red.
    let across = [[0.5, 0.0], [1.5, 0.0], [1.5, 1.0], [0.5, 1.0]];
    let found = baked_row(mtl, &row(&["usemtl halves"], &[], across), 1);
    let either =
        |channel: usize, a: f64, b: f64| found[0][channel] > a.min(b) - 4.0 && found[0][channel] < a.max(b) + 4.0;
    assert!(either(0, 10.0, 220.0) && either(2, 10.0, 200.0), "{found:?}");
}

/// A square in `in/in.obj` that shows the image of this name if it may, and grey otherwise.
fn square_that_names(root: &Path, name: &str) {
    fs::create_dir(root.join("in")).unwrap();
    fs::write(root.join("in/a.mtl"), format!("newmtl a\nKd 0.2 0.2 0.2\nmap_Kd {name}\n")).unwrap();
    fs::write(root.join("in/in.obj"), row(&["usemtl a"], &[], WHOLE)).unwrap();
}

#[test]
fn images_outside_of_the_folder_are_baked_where_the_user_allows_it() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    let image = image::RgbImage::from_pixel(32, 32, image::Rgb([200, 30, 10]));
    image.save(root.join("private.png")).unwrap();
    let absolute = root.join("private.png");
    for (number, name) in ["../../private.png", absolute.to_str().unwrap()].into_iter().enumerate() {
        let root = root.join(number.to_string());
        fs::create_dir(&root).unwrap();
        square_that_names(&root, name);
        for textures_outside in [TexturesOutside::Refer, TexturesOutside::Copy] {
            let is_read = textures_outside == TexturesOutside::Copy;
            let refused = |warnings: &[String]| warnings.iter().any(|words| words.starts_with("refused texture"));
            let options = SimplifyOptions { textures_outside, ..baked(ratio(1.0)) };
            let job = JobOptions { force: true, ..options.job.clone() };
            let options = SimplifyOptions { job, image: ImageFormat::Png, ..options };
            let planned = plan::plan(root.join("in/in.obj"), &options, &Silent).unwrap();
            assert_eq!(refused(&planned.warnings), !is_read);
            let report = pipeline::simplify(root.join("in/in.obj"), &root.join("out.obj"), &options, &Silent).unwrap();
            assert_eq!(refused(&report.warnings), !is_read, "{:?}", report.warnings);
            let shown = if is_read { [200.0, 30.0, 10.0] } else { [51.0; 3] };
            assert_near(&colours_of_row(&root, 1), &[shown]);

            let options = TileOptions { textures_outside, ..TileOptions::default() };
            let output = root.join(format!("{textures_outside:?}"));
            let report = pipeline::tile(root.join("in/in.obj"), &output, &options, &Silent).unwrap();
            assert_eq!(refused(&report.warnings), !is_read, "{:?}", report.warnings);
        }
    }
}

#[test]
fn an_image_that_lies_beside_the_mtl_instead_is_a_part_of_the_input() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().canonicalize().unwrap();
    square_that_names(&root, "photos/n.png");
    let save = |colour: [u8; 3]| {
        image::RgbImage::from_pixel(32, 32, image::Rgb(colour)).save(root.join("in/n.png")).unwrap();
    };
    save([200, 30, 10]);
    let job = JobOptions { keep_work: true, ..JobOptions::default() };
    let options = SimplifyOptions { job, image: ImageFormat::Png, ..baked(ratio(1.0)) };
    let run =
        |options: &SimplifyOptions| pipeline::simplify(root.join("in/in.obj"), &root.join("out.obj"), options, &Silent);
    run(&options).unwrap();
    assert_near(&colours_of_row(&root, 1), &[[200.0, 30.0, 10.0]]);
    save([20, 30, 250]);
    let job = JobOptions { force: true, ..options.job.clone() };
    let options = SimplifyOptions { job, ..options };
    assert_eq!(run(&options).unwrap_err().kind(), ErrorKind::Changed);
    let job = JobOptions { resume: ResumeChoice::Never, ..options.job.clone() };
    run(&SimplifyOptions { job, ..options.clone() }).unwrap();
    assert_near(&colours_of_row(&root, 1), &[[20.0, 30.0, 250.0]]);
}

#[test]
fn colours_of_vertices_are_baked() {
    let text = row(&["", ""], &["1 0 0", "0 0.5 1"], WHOLE);
    assert_near(&baked_row("", &text, 2), &[[255.0, 0.0, 0.0], [0.0, 128.0, 255.0]]);
}

#[test]
fn colours_of_vertices_from_0_to_255_are_baked() {
    let text = row(&["", ""], &["200 40 30", "1 0 128"], WHOLE);
    assert_near(&baked_row("", &text, 2), &[[200.0, 40.0, 30.0], [1.0, 0.0, 128.0]]);
}

#[test]
fn the_colour_of_a_material_shows_where_its_image_does_not() {
    let mtl = "newmtl green\nKd 1 0 0\nmap_Kd green.png\nnewmtl bad\nKd 0.2 0.4 0.6\nmap_Kd bad.png\n\
               newmtl missing\nKd 0 0 1\nmap_Kd missing.png\n";
    let squares = ["usemtl green", "usemtl bad", "usemtl bad", "usemtl missing"];
    // The first without texture coordinates, the third with colours of vertices.
    let text = row(&squares, &["", "", "0 1 0"], WHOLE).replacen("f 1/1 2/2 3/3 4/4", "f 1 2 3 4", 1);
    let expected = [[255.0, 0.0, 0.0], [51.0, 102.0, 153.0], [0.0, 255.0, 0.0], [0.0, 0.0, 255.0]];
    assert_near(&baked_row(mtl, &text, 4), &expected);
}

#[test]
fn a_chart_thinner_than_a_texel_shows_its_colours_along_all_of_it() {
    let red = [[0.1, 0.2], [0.4, 0.2], [0.4, 0.8], [0.1, 0.8]];
    let mut text = row(&["usemtl halves"], &[], red);
    text += "v 2 0 0\nv 3 0 0\nv 2.5 0.0005 0\nvt 0.6 0.5\nvt 0.9 0.5\nvt 0.7 0.7\nf 5/5 6/6 7/7\n";
    let run = bake_row("newmtl halves\nmap_Kd halves.png\n", &text);
    let (image, triangles) = shown_by_row(run.folder());
    let (_, corners) = triangles.into_iter().find(|(square, _)| *square == 1).unwrap();
    for (from, to) in [(0, 1), (1, 2), (2, 0)].map(|(from, to)| (corners[from], corners[to])) {
        for step in 0..=16 {
            let [x, y] = [0, 1].map(|axis| from[axis] + (to[axis] - from[axis]) * f64::from(step) / 16.0);
            let found = image.get_pixel(x as u32, y as u32).0.map(f64::from);
            assert_near(&[found], &[[10.0, 30.0, 200.0]]);
        }
    }
}

#[test]
fn the_two_sides_of_a_wall_do_not_mix() {
    let mtl = "newmtl halves\nmap_Kd halves.png\n";
    let uv = |at: f64| [[at, 0.2], [at + 0.2, 0.2], [at + 0.2, 0.8], [at, 0.8]];
    // Both sides of the square, a hundredth apart, the front red, the back blue.
    let mut text = row(&["usemtl halves"], &[], uv(0.1));
    for [x, y] in [[0, 0], [0, 1], [1, 1], [1, 0]] {
        text += &format!("v {x} {y} -0.01\n");
    }
    uv(0.7).iter().for_each(|[u, v]| text += &format!("vt {u} {v}\n"));
    text += "f 5/5 6/6 7/7 8/8\n";
    let folder = tempfile::tempdir().unwrap();
    image::RgbImage::from_fn(64, 64, |x, _| image::Rgb(if x < 32 { [220, 20, 10] } else { [10, 30, 200] }))
        .save(folder.path().join("halves.png"))
        .unwrap();
    fs::write(folder.path().join("a.mtl"), mtl).unwrap();
    fs::write(folder.path().join("in.obj"), text).unwrap();
    let run = simplify(&folder.path().join("in.obj"), &baked(ratio(1.0)));
    let texture = compared(&folder.path().join("in.obj"), &run.output).texture.unwrap();
    assert!(texture.colour_rms < 3.0, "{texture:?}");
}

#[test]
fn images_are_written_as_asked_for() {
    for (format, magic) in [(ImageFormat::Png, &b"\x89PNG"[..]), (ImageFormat::Jpeg(80), &b"\xff\xd8"[..])] {
        let options = SimplifyOptions { image: format, atlas: 256, texels: 0.25, ..baked(ratio(0.2)) };
        let run = simplify(&town(), &options);
        for (path, bytes) in contents(&run.folder().join("out_textures")) {
            assert!(bytes.starts_with(magic), "{}", path.display());
            let image = image::load_from_memory(&bytes).unwrap();
            assert!(image.width() <= 256 && image.height() <= 256);
        }
    }
}

#[test]
fn an_image_that_does_not_fit_the_memory_is_refused_before_the_passes() {
    let folder = tempfile::tempdir().unwrap();
    let limits = Limits { memory: Some(128 << 20), threads: Some(1) };
    let options = SimplifyOptions { atlas: 16384, limits, ..baked(ratio(0.5)) };
    let error = pipeline::simplify(town(), &folder.path().join("a.obj"), &options, &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Budget, "{error}");
    assert!(error.to_string().contains("`atlas`"), "{error}");
}

#[test]
fn files_of_others_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("a_textures")).unwrap();
    fs::write(folder.path().join("a_textures/mine.png"), "mine").unwrap();
    let output = folder.path().join("a.obj");
    let error = pipeline::simplify(town(), &output, &baked(ratio(0.5)), &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
    assert_eq!(fs::read(folder.path().join("a_textures/mine.png")).unwrap(), b"mine");
}

#[test]
fn a_damaged_image_costs_its_colours_alone() {
    let folder = tempfile::tempdir().unwrap();
    copy_town(&folder.path().join("in"));
    let roof = folder.path().join("in/roof.jpg");
    let bytes = fs::read(&roof).unwrap();
    fs::write(&roof, &bytes[..60]).unwrap();
    let mtl = fs::read_to_string(folder.path().join("in/town.mtl")).unwrap();
    fs::write(folder.path().join("in/town.mtl"), mtl.replace("Kd 1 1 1\n", "\n")).unwrap();
    let run = simplify(&folder.path().join("in/town.obj"), &baked(ratio(0.3)));
    assert_eq!(run.report.repairs.get("unreadable_image"), Some(&1));
    assert!(run.report.bake.unwrap().colourless > 0);
}

#[test]
fn a_mesh_in_memory_is_not_baked() {
    let mesh = drystone::Mesh { positions: vec![[0.0; 3]; 3], faces: vec![[0, 1, 2]], ..Default::default() };
    let error = drystone::simplify_mesh(&mesh, &baked(ratio(0.5)), &Silent).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Usage, "{error}");
}

#[test]
fn a_ply_names_its_baked_images() {
    let folder = tempfile::tempdir().unwrap();
    let output = folder.path().join("a.ply");
    pipeline::simplify(town(), &output, &baked(ratio(0.2)), &Silent).unwrap();
    let images = contents(&folder.path().join("a_textures"));
    assert_eq!(images.len(), 1);
    let texture = compared(&town(), &output).texture.unwrap();
    assert!(texture.colour_rms < 10.0, "{texture:?}");
}

#[test]
fn a_plain_material_needs_no_texture_coordinates_and_colours_of_vertices_come_before_it() {
    let mtl = "newmtl plain\nKd 0.2 0.4 0.6\n";
    let text = row(&["usemtl plain", "usemtl plain"], &["", "1 0 0"], WHOLE);
    let bare: String = text
        .lines()
        .filter(|line| !line.starts_with("vt "))
        .map(|line| {
            let corner = |word: &str| word.split('/').next().unwrap_or(word).to_owned();
            line.split(' ').map(corner).collect::<Vec<_>>().join(" ") + "\n"
        })
        .collect();
    assert_near(&baked_row(mtl, &bare, 2), &[[51.0, 102.0, 153.0], [255.0, 0.0, 0.0]]);
}

#[test]
fn texels_lie_as_densely_as_those_of_the_input() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::from_fn(256, 256, |x, y| image::Rgb([x as u8, y as u8, 90])).save(path("a.png")).unwrap();
    fs::write(path("a.mtl"), "newmtl a\nmap_Kd a.png\n").unwrap();
    // Sides of the parts of the image that the squares show: one texel in two is as long as in the third square.
    let shares = [1.0, 0.9, 0.8, 0.7, 0.1];
    let parts = shares.map(|share| WHOLE.map(|corner| corner.map(|at| at * share)));
    fs::write(path("in.obj"), row_of_parts(&["usemtl a"; 5], &[], &parts)).unwrap();
    let report = pipeline::simplify(path("in.obj"), &path("out.obj"), &baked(ratio(1.0)), &Silent).unwrap();
    let median = 0.8 * 256.0;
    let texel = report.bake.unwrap().texel;
    assert!((texel * median - 1.0).abs() < 0.02, "{texel}");

    let mut areas = [0.0; 5];
    for (square, [a, b, c]) in shown_by_row(folder.path()).1 {
        areas[square] += 0.5 * ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])).abs();
    }
    // No texel is longer than √2 of the median.
    for (area, share) in areas.into_iter().zip(shares) {
        let expected = (share * 256.0).max(median * 0.5f64.sqrt());
        assert!((area.sqrt() / expected - 1.0).abs() < 0.03, "{share}: {} {expected}", area.sqrt());
    }
}

#[test]
fn a_plan_foretells_images_and_texels() {
    for (texels, atlas) in [(1.0, 4096), (0.25, 4096), (1.0, 1024), (4.0, 512)] {
        let options = SimplifyOptions { texels, atlas, ..baked(ratio(0.2)) };
        let foretold = plan::plan(town(), &options, &Silent).unwrap().bake.unwrap();
        let bake = simplify(&town(), &options).report.bake.unwrap();
        let of = |foretold: u64, found: u64| foretold as f64 / found as f64;
        let (texels, images) = (of(foretold.texels, bake.texels), of(foretold.images, bake.images));
        assert!((0.7..1.4).contains(&texels), "{foretold:?} {bake:?}");
        assert!((0.5..=2.0).contains(&images), "{foretold:?} {bake:?}");
        assert_eq!((foretold.input_images, foretold.input_pixels), (4, 4 * 512 * 512));
    }
}

#[test]
fn a_plan_counts_what_repeats_and_what_has_no_image() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    image::RgbImage::new(64, 64).save(path("image.png")).unwrap();
    fs::write(path("in.obj"), row(&["usemtl a", "usemtl b"], &[], WHOLE)).unwrap();
    let texels = |mtl: &str| {
        fs::write(path("a.mtl"), mtl).unwrap();
        plan::plan(path("in.obj"), &baked(ratio(1.0)), &Silent).unwrap().bake.unwrap().texels as f64
    };
    let once = texels("newmtl a\nmap_Kd image.png\n");
    assert!((1.0..2.0).contains(&(once / f64::from(64 * 64))), "{once}");
    assert!((texels("newmtl a\nmap_Kd -s 3 2 1 image.png\n") / once - 6.0).abs() < 0.01);
    assert!((texels("newmtl a\nmap_Kd image.png\nnewmtl b\nmap_Kd image.png\n") / once - 2.0).abs() < 0.01);
    assert!(texels("newmtl a\nKd 1 0 0\n") < 0.1 * once);
    // Indices that count back name the same texture coordinates.
    let text = fs::read_to_string(path("in.obj")).unwrap();
    let back =
        |line: &str| if line.starts_with("f ") { "f -4/-4 -3/-3 -2/-2 -1/-1".to_owned() } else { line.to_owned() };
    fs::write(path("in.obj"), text.lines().map(back).collect::<Vec<_>>().join("\n")).unwrap();
    assert_eq!(texels("newmtl a\nmap_Kd image.png\n"), once);
    let text = fs::read_to_string(path("in.obj")).unwrap();
    fs::write(path("in.obj"), format!("\u{feff}{text}")).unwrap();
    assert_eq!(texels("newmtl a\nmap_Kd image.png\n"), once);
}

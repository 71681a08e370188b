//! The kept inputs of the fuzz targets, and seeded changes of them: what was found once is never met again.

#[path = "../fuzz/targets.rs"]
mod targets;

use std::fs;

/// Changes of each kept input; `DRYSTONE_CHANGES` asks for more.
const CHANGES: u64 = 12;

/// The next number of a sequence that looks random.
fn next(state: &mut u64) -> usize {
    *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
    let mixed = (*state ^ *state >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    ((mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb) >> 33) as usize
}

/// Changes a few bytes, or cuts, doubles or moves a stretch.
fn changed(bytes: &[u8], state: &mut u64) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..1 + next(state) % 4 {
        let length = out.len().max(1);
        let (at, to) = (next(state) % length, next(state) % length);
        let (low, high) = (at.min(to).min(out.len()), at.max(to).min(out.len()));
        match next(state) % 5 {
            0 => out.truncate(high),
            1 => out.extend_from_within(low..high),
            2 => _ = out.drain(low..high),
            3 => out.push(next(state) as u8),
            _ => {
                if let Some(byte) = out.get_mut(at) {
                    *byte ^= 1 << (next(state) % 8);
                }
            }
        }
    }
    out.truncate(4096);
    out
}

fn replay(name: &str) {
    let (_, target) = targets::TARGETS.into_iter().find(|(known, _)| *known == name).unwrap();
    let changes = std::env::var("DRYSTONE_CHANGES").ok().and_then(|count| count.parse().ok()).unwrap_or(CHANGES);
    let mut paths: Vec<_> =
        fs::read_dir(format!("fuzz/corpus/{name}")).unwrap().flatten().map(|entry| entry.path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "no kept input of {name}");
    for path in paths {
        let bytes = fs::read(&path).unwrap();
        target(&bytes);
        let mut state = bytes.len() as u64;
        for _ in 0..changes {
            target(&changed(&bytes, &mut state));
        }
    }
}

#[test]
fn kept_obj_files_are_read_or_refused() {
    replay("scan_obj");
}

#[test]
fn kept_material_libraries_are_read_or_refused() {
    replay("scan_mtl");
}

#[test]
fn kept_ply_files_are_read_or_refused() {
    replay("scan_ply");
}

#[test]
fn kept_array_files_are_read_or_refused_as_a_simple_reader_does() {
    replay("scan_arrays");
}

#[test]
fn kept_changes_of_stages_are_found() {
    replay("lent");
}

#[test]
fn kept_files_of_a_work_folder_are_read_or_refused() {
    replay("job_files");
}

#[test]
fn kept_changes_of_a_half_done_job_end_with_the_same_bytes_or_an_error() {
    replay("resume");
}

#[test]
fn kept_meshes_and_options_give_a_result_that_can_be_read() {
    replay("collapse");
}

#[test]
fn kept_lines_are_counted_as_a_simple_reader_does() {
    replay("differential");
}

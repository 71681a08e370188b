use super::finished::write_value;
use super::journal::JOURNAL;
use super::manifest::MANIFEST;
use super::*;
use crate::base::ErrorKind;
use crate::base::pool::{Durability, Pool};
use crate::os::durable::witness;

const SCAN: StepKey = StepKey::fixed("scan-mesh");
const RESULT: StepKey = StepKey::fixed("write-result");

fn mesh(pass: u32) -> StepKey {
    StepKey::numbered(format!("pass-{pass}-mesh"))
}

fn partition(pass: u32) -> StepKey {
    StepKey::numbered(format!("pass-{pass}-partition"))
}

fn cluster(pass: u32, cluster: u32) -> StepKey {
    StepKey::numbered(format!("pass-{pass}-cluster-0-{cluster:06}"))
}

fn manifest() -> Manifest {
    let (program, options) = ("0".into(), r#"{"ratio": 0.1}"#.into());
    Manifest { program, options, inputs: Vec::new(), passes: 3, ..Manifest::default() }
}

fn open(path: &Path, resume: Resume) -> Result<WorkFolder> {
    WorkFolder::open(path, &manifest(), resume)
}

/// A folder with the steps `scan-mesh` (a file and a large value) and `pass-0-mesh` (a small value), left by a killed job.
fn left_over(path: &Path) {
    let job = open(path, Resume::Auto).unwrap();
    let file = path.join("scan-0-positions.col");
    fs::rename(path.join(write_value(&path.join("scan-x.state"), b"positions").unwrap().name()), &file).unwrap();
    job.keep(Step::new(SCAN), [file.as_path()], &vec![7u32; 5000]).unwrap();
    job.keep(Step::new(mesh(0)).from([SCAN]), [], &(1u8, 2u8)).unwrap();
}

macro_rules! always_sound {
    ($($value:ty),+) => {
        $(impl Recalled for $value {
            type Context<'a> = ();

            fn is_sound(&self, (): &()) -> bool {
                true
            }
        })+
    };
}

always_sound!(Vec<u32>, (u8, u8), u8, ());

#[test]
fn a_folder_is_removed_with_its_job_and_locked_while_it_runs() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    assert!(matches!(open(&path, Resume::Auto), Err(Error::Locked(_))));
    job.finish(false).unwrap();
    assert!(!path.exists());
}

#[test]
fn steps_of_a_killed_job_are_recalled() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    fs::write(path.join("pass-0-cluster-000001.piece.tmp"), "cut sho").unwrap();
    let job = open(&path, Resume::Require).unwrap();
    assert!(job.is_resumed());
    assert_eq!(job.latest(), [mesh(0), SCAN]);
    assert_eq!(job.recall::<Vec<u32>>(&SCAN, &()).unwrap(), Some(vec![7; 5000]));
    assert_eq!(job.recall::<(u8, u8)>(&mesh(0), &()).unwrap(), Some((1, 2)));
    assert_eq!(job.recall::<u8>(&RESULT, &()).unwrap(), None);
    assert!(!path.join("pass-0-cluster-000001.piece.tmp").exists());
}

#[test]
fn a_damaged_step_is_forgotten_or_refused() {
    for name in ["scan-0-positions.col", "scan-mesh.state"] {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        left_over(&path);
        let mut bytes = fs::read(path.join(name)).unwrap();
        *bytes.last_mut().unwrap() ^= 1;
        fs::write(path.join(name), bytes).unwrap();
        let job = open(&path, Resume::Auto).unwrap();
        assert_eq!(job.recall::<Vec<u32>>(&SCAN, &()).unwrap(), None);
        assert!(job.take_damage()[0].contains(name));
        drop(job);
        let job = open(&path, Resume::Require).unwrap();
        assert!(matches!(job.recall::<Vec<u32>>(&SCAN, &()), Err(Error::Damaged { .. })));
    }
}

#[test]
fn another_job_is_refused_and_left_alone_unless_it_may_go() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let other = Manifest { options: r#"{"ratio": 0.2}"#.into(), ..manifest() };
    let error = WorkFolder::open(&path, &other, Resume::Auto).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Changed);
    assert!(error.to_string().contains("`ratio` was 0.1, is 0.2"), "{error}");
    assert!(path.join("scan-0-positions.col").exists());
    let job = WorkFolder::open(&path, &other, Resume::Never).unwrap();
    assert!(!job.is_resumed() && !path.join("scan-0-positions.col").exists());
}

#[test]
fn nothing_to_go_on_with_is_an_error_only_if_that_is_required() {
    let parent = tempfile::tempdir().unwrap();
    assert_eq!(open(&parent.path().join("work"), Resume::Require).unwrap_err().kind(), ErrorKind::Changed);
    assert!(!open(&parent.path().join("work"), Resume::Auto).unwrap().is_resumed());
}

#[test]
fn what_is_no_longer_needed_goes_and_the_rest_is_still_recalled() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let job = open(&path, Resume::Auto).unwrap();
    job.retain(&[mesh(0)]).unwrap();
    assert!(!path.join("scan-0-positions.col").exists());
    job.keep(Step::new(mesh(1)), [], &()).unwrap();
    drop(job);
    let job = open(&path, Resume::Auto).unwrap();
    assert_eq!(job.recall::<Vec<u32>>(&SCAN, &()).unwrap(), None);
    assert_eq!(job.recall::<()>(&mesh(1), &()).unwrap(), Some(()));
    assert!(job.take_damage().is_empty());
}

#[test]
fn a_step_that_supersedes_others_is_kept_and_leaves_what_was_begun_since() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let job = open(&path, Resume::Auto).unwrap();
    job.supersede(Step::new(mesh(1)), [], &vec![9u32; 5000], &[]).unwrap();
    let begun = path.join("pass-2-positions.col");
    fs::write(&begun, b"begun").unwrap();
    job.wait_until_durable().unwrap();
    assert!(begun.exists());
    assert!(!path.join("scan-0-positions.col").exists());
    drop(job);
    let job = open(&path, Resume::Auto).unwrap();
    assert_eq!(job.recall::<Vec<u32>>(&mesh(1), &()).unwrap(), Some(vec![9; 5000]));
    assert_eq!(job.recall::<Vec<u32>>(&SCAN, &()).unwrap(), None);
}

#[test]
fn what_an_earlier_process_left_of_later_steps_is_not_in_the_way() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let piece = path.join("pass-1-cluster-0-000000.piece");
    left_over(&path);
    let job = open(&path, Resume::Auto).unwrap();
    // Killed after a cluster was recorded, before the partition that it belongs to was.
    fs::rename(path.join(write_value(&path.join("scan-x.state"), b"a cluster").unwrap().name()), &piece).unwrap();
    job.keep(Step::new(cluster(1, 0)).from([partition(1)]), [piece.as_path()], &()).unwrap();
    drop(job);
    let job = open(&path, Resume::Auto).unwrap();
    job.supersede(Step::new(partition(1)).from([mesh(0)]), [], &(), &[mesh(0)]).unwrap();
    assert!(!piece.exists());
    fs::write(&piece, b"made anew").unwrap();
    job.wait_until_durable().unwrap();
    assert_eq!(fs::read(&piece).unwrap(), b"made anew");
}

#[test]
fn what_fails_beside_the_work_is_told_when_it_is_waited_for() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    // The value is to be renamed onto a folder that is not empty.
    fs::create_dir_all(path.join(SCAN.file_name()).join("in the way")).unwrap();
    job.supersede(Step::new(SCAN), [], &vec![9u32; 5000], &[]).unwrap();
    assert!(job.wait_until_durable().is_err());
    assert!(job.wait_until_durable().is_ok());
}

#[test]
fn a_job_that_kept_nothing_leaves_no_folder() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    job.note_failure(&Error::Limit("of patience".into()));
    drop(job);
    assert!(!path.exists());
}

#[test]
fn a_folder_left_by_a_killed_job_goes_with_the_next_one() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    open(&path, Resume::Auto).unwrap().finish(false).unwrap();
    assert!(!path.exists());
}

#[test]
fn an_empty_folder_of_the_user_stays() {
    let parent = tempfile::tempdir().unwrap();
    open(parent.path(), Resume::Auto).unwrap().finish(false).unwrap();
    assert!(parent.path().exists());
}

#[test]
fn a_folder_with_foreign_files_is_refused_and_left_alone() {
    for name in ["thesis.txt", "scan-of-my-passport.pdf"] {
        let parent = tempfile::tempdir().unwrap();
        fs::write(parent.path().join(name), "years of work").unwrap();
        assert!(matches!(open(parent.path(), Resume::Never), Err(Error::Usage(_))));
        assert!(parent.path().join(name).exists());
    }
}

#[test]
fn a_damaged_manifest_is_an_error_and_a_damaged_journal_is_not() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    fs::write(path.join(JOURNAL), "torn").unwrap();
    assert!(!open(&path, Resume::Auto).unwrap().is_resumed());
    left_over(&path);
    fs::write(path.join(MANIFEST), "torn").unwrap();
    assert_eq!(open(&path, Resume::Auto).unwrap_err().kind(), ErrorKind::Damaged);
    assert!(open(&path, Resume::Never).is_ok());
}

#[test]
fn a_job_can_be_looked_at_while_it_runs() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let job = open(&path, Resume::Auto).unwrap();
    let status = look(&path).unwrap();
    assert!(status.is_running && status.bytes > 0);
    let kept = |entry: &&Entry| matches!(entry, Entry::Kept(_));
    assert_eq!(status.entries.iter().filter(kept).count(), 2);
    drop(job);
    assert!(!look(&path).unwrap().is_running);
}

#[test]
fn files_that_are_named_like_ours_are_not_taken_for_ours() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    fs::create_dir(&path).unwrap();
    for name in ["scan-000001.bin", "pass-notes.tmp", "lock", "manifest.bin", "manifest.bin.tmp", "journal.bin"] {
        fs::write(path.join(name), "of the user").unwrap();
        for resume in [Resume::Auto, Resume::Require, Resume::Never] {
            let error = open(&path, resume).unwrap_err();
            let words = format!("'{name}' is not a file of a job, or a damaged one");
            assert!(error.to_string().contains(&words), "{error}");
        }
        assert_eq!(fs::read(path.join(name)).unwrap(), b"of the user");
        fs::remove_file(path.join(name)).unwrap();
    }
    fs::write(path.join("manifest.bin.tmp"), [0; 64]).unwrap();
    assert!(!open(&path, Resume::Auto).unwrap().is_resumed());
}

#[test]
fn the_journal_of_another_job_is_not_gone_on_with() {
    let parent = tempfile::tempdir().unwrap();
    let (one, other) = (parent.path().join("one"), parent.path().join("other"));
    left_over(&one);
    left_over(&other);
    fs::copy(other.join(MANIFEST), one.join(MANIFEST)).unwrap();
    assert!(matches!(open(&one, Resume::Require), Err(Error::Damaged { .. })));
    assert!(!open(&one, Resume::Auto).unwrap().is_resumed());
    assert!(open(&other, Resume::Auto).unwrap().is_resumed());
}

#[test]
fn a_hundred_thousand_entries_are_read_in_a_moment() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    for at in 0..100_000 {
        job.keep(Step::new(cluster(0, at)), [], &()).unwrap();
    }
    drop(job);
    let job = open(&path, Resume::Auto).unwrap();
    assert_eq!(job.latest().len(), 100_000);
    assert_eq!(job.latest()[0], cluster(0, 99_999));
}

#[test]
fn a_file_that_should_be_there_and_is_not_is_damage() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    let step = cluster(0, 0);
    job.keep(Step::new(partition(0)), [], &()).unwrap();
    job.keep(Step::new(step.clone()).from([partition(0)]), [], &vec![7u32; 5000]).unwrap();
    drop(job);
    fs::remove_file(path.join(step.file_name())).unwrap();
    let job = open(&path, Resume::Auto).unwrap();
    assert_eq!(job.recall::<Vec<u32>>(&step, &()).unwrap(), None);
    assert!(job.take_damage()[0].contains("it is gone"));
    drop(job);
    let job = open(&path, Resume::Require).unwrap();
    assert!(matches!(job.recall::<Vec<u32>>(&step, &()), Err(Error::Damaged { .. })));
    drop(job);
    // Once the partition that it belongs to is recomputed, it is not missed.
    let job = open(&path, Resume::Require).unwrap();
    job.supersede(Step::new(partition(0)), [], &(), &[]).unwrap();
    assert_eq!(job.recall::<Vec<u32>>(&step, &()).unwrap(), None);
}

#[test]
fn a_journal_that_is_gone_is_damage_where_files_are_left() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    fs::remove_file(path.join(JOURNAL)).unwrap();
    assert!(matches!(open(&path, Resume::Require), Err(Error::Damaged { .. })));
    let job = open(&path, Resume::Auto).unwrap();
    assert!(!job.is_resumed() && job.take_damage()[0].contains("it is gone"));
}

#[test]
fn a_manifest_that_is_gone_is_damage_where_a_journal_is_left() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    fs::remove_file(path.join(MANIFEST)).unwrap();
    assert!(matches!(look(&path), Err(Error::Damaged { .. })));
    assert!(matches!(open(&path, Resume::Require), Err(Error::Damaged { .. })));
    let job = open(&path, Resume::Auto).unwrap();
    assert!(!job.is_resumed() && job.take_damage()[0].contains("it is gone"));
}

#[test]
fn a_journal_that_must_be_whole_is_not_cut() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let mut bytes = fs::read(path.join(JOURNAL)).unwrap();
    bytes[HEADER_BYTES as usize + 20] ^= 1;
    fs::write(path.join(JOURNAL), &bytes).unwrap();
    assert!(matches!(open(&path, Resume::Require), Err(Error::Damaged { .. })));
    assert_eq!(fs::read(path.join(JOURNAL)).unwrap(), bytes);
}

#[test]
fn zeros_that_a_power_cut_leaves_are_no_damage() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let whole = fs::read(path.join(JOURNAL)).unwrap();
    fs::write(path.join(JOURNAL), [&whole[..], &[0; 100]].concat()).unwrap();
    let job = open(&path, Resume::Require).unwrap();
    assert!(job.is_resumed() && job.take_damage()[0].contains("cut short"));
    drop(job);
    fs::write(path.join(JOURNAL), [&whole[..], &[0; 99], &[1]].concat()).unwrap();
    assert!(matches!(open(&path, Resume::Require), Err(Error::Damaged { .. })));
}

#[test]
fn where_nothing_is_to_be_gone_on_with_nothing_is_made() {
    let parent = tempfile::tempdir().unwrap();
    assert_eq!(open(&parent.path().join("work"), Resume::Require).unwrap_err().kind(), ErrorKind::Changed);
    assert_eq!(fs::read_dir(parent.path()).unwrap().count(), 0);
}

#[test]
fn what_is_cut_off_a_journal_is_told() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let journal = File::options().write(true).open(path.join(JOURNAL)).unwrap();
    journal.set_len(journal.metadata().unwrap().len() - 3).unwrap();
    let job = open(&path, Resume::Auto).unwrap();
    assert!(job.take_damage()[0].contains("cut short"));
    drop(job);
    fs::remove_file(path.join(JOURNAL)).unwrap();
    let job = open(&path, Resume::Auto).unwrap();
    assert!(!job.is_resumed() && job.take_damage()[0].contains("it is gone"));
}

/// A power cut removes only unsynced entries from a journal.
#[test]
fn entries_are_durable_before_anything_that_relies_on_them() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    let is_durable = || lock(&job.journal).as_ref().unwrap().is_durable();

    job.keep(Step::new(mesh(0)), [], &1u8).unwrap();
    assert!(!is_durable(), "the test must be able to tell");
    job.sync().unwrap();
    assert!(is_durable());

    // The files of superseded steps are removed.
    job.supersede(Step::new(mesh(1)), [], &2u8, &[]).unwrap();
    job.wait_until_durable().unwrap();
    assert!(is_durable());

    job.keep(Step::new(mesh(2)), [], &3u8).unwrap();
    job.retain(&[mesh(2)]).unwrap();
    assert!(is_durable());

    job.keep(Step::new(mesh(3)), [], &4u8).unwrap();
    job.note_failure(&Error::Usage("no".into()));
    assert!(is_durable());
}

/// Without the entries, the steps whose files were removed are redone.
#[test]
fn a_short_job_syncs_its_journal_when_it_is_told_to() {
    let _inside = Pool::with(1, Durability::Result).unwrap().enter();
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    let is_durable = || lock(&job.journal).as_ref().unwrap().is_durable();
    job.keep(Step::new(mesh(0)), [], &1u8).unwrap();
    job.supersede(Step::new(mesh(1)), [], &2u8, &[]).unwrap();
    job.retain(&[mesh(1)]).unwrap();
    assert!(!is_durable());
    job.sync().unwrap();
    assert!(is_durable());
}

#[test]
fn a_job_that_begins_afresh_leaves_nothing_of_the_one_before() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let mut job = open(&path, Resume::Auto).unwrap();
    job.restart(&manifest()).unwrap();
    let mut names: Vec<_> = fs::read_dir(&path).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, [JOURNAL, lease::LEASE, LOCK, MANIFEST]);
}

#[test]
fn who_lost_the_folder_changes_nothing_in_it() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let mut job = open(&path, Resume::Auto).unwrap();
    job.keep(Step::new(mesh(1)), [], &4u8).unwrap();
    let (lease, theirs) = (path.join(lease::LEASE), path.join("pass-1-theirs.bin"));
    fs::write(&theirs, "theirs").unwrap();
    fs::remove_file(&lease).unwrap();
    fs::write(&lease, "00000000000000aa 0000000000000001 another-machine 7").unwrap();
    assert!(matches!(job.loss(), Some(Error::Locked(_))));
    let before = fs::read(path.join(JOURNAL)).unwrap();
    let outcomes =
        [job.retain(&[]), job.supersede(Step::new(mesh(2)), [], &5u8, &[]), job.restart(&manifest()), job.confirm()];
    assert!(outcomes.iter().all(|outcome| matches!(outcome, Err(Error::Locked(_)))), "{outcomes:?}");
    assert!(matches!(job.finish(false), Err(Error::Locked(_))));
    assert!(theirs.exists() && lease.exists());
    assert!(fs::read(path.join(JOURNAL)).unwrap() == before);
}

#[test]
fn what_a_network_disk_keeps_of_removed_files_is_not_foreign() {
    for name in [".nfs00000000a1b2", ".fuse_hidden0000000100000002"] {
        let parent = tempfile::tempdir().unwrap();
        let path = parent.path().join("work");
        let job = open(&path, Resume::Auto).unwrap();
        let stage = path.join("stage-0123456789abcdef");
        fs::create_dir(&stage).unwrap();
        for folder in [&path, &stage] {
            fs::write(folder.join(name), "open elsewhere").unwrap();
        }
        job.finish(false).unwrap();
        fs::create_dir_all(&stage).unwrap();
        fs::write(stage.join(name), "open elsewhere").unwrap();
        open(&path, Resume::Auto).unwrap().finish(false).unwrap();
        for other in [".nfs", ".nfsnotes", ".fuse_hidden-mine"] {
            fs::create_dir_all(&path).unwrap();
            fs::write(path.join(other), "").unwrap();
            assert!(matches!(open(&path, Resume::Auto), Err(Error::Usage(_))), "{other}");
            fs::remove_file(path.join(other)).unwrap();
        }
    }
}

/// If the manifest were removed before other files, or files before the journal that lists them, a power cut would
/// leave a folder that cannot be resumed.
#[test]
fn a_job_that_begins_afresh_takes_its_files_away_in_an_order_that_a_power_cut_may_end() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    witness::take();
    open(&path, Resume::Again).unwrap();
    let [journal, manifest] = [JOURNAL, MANIFEST].map(|name| path.join(name));
    let waiting = |name: &str| path.join(format!("{name}.tmp"));
    let expected = [
        ("sync", journal.clone()),
        ("sync", path.clone()),
        ("sync", waiting(MANIFEST)),
        ("rename", manifest),
        ("sync", path.clone()),
        ("sync", waiting(JOURNAL)),
        ("rename", journal),
        ("sync", path.clone()),
    ];
    assert_eq!(witness::take(), expected);
}

#[test]
fn a_job_that_was_killed_before_its_first_step_leaves_no_folder_either() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    let job = open(&path, Resume::Auto).unwrap();
    // As a kill leaves it: nothing is cleaned up.
    std::mem::forget(job);
    fs::remove_file(path.join(LOCK)).unwrap();
    drop(open(&path, Resume::Auto).unwrap());
    assert!(!path.exists());
}

#[test]
fn work_that_is_never_gone_on_with_begins_anew_in_a_folder_of_its_kind_only() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let other = Manifest { options: "compare".into(), ..manifest() };
    let error = WorkFolder::open(&path, &other, Resume::Again).unwrap_err();
    assert_eq!(error.kind(), ErrorKind::Changed);
    assert!(path.join("scan-0-positions.col").exists());
    let moved = Manifest {
        inputs: vec![InputFile { path: "/a.obj".into(), leads_to: "/a.obj".into(), bytes: 1 }],
        ..manifest()
    };
    let job = WorkFolder::open(&path, &moved, Resume::Again).unwrap();
    assert!(!job.is_resumed() && !path.join("scan-0-positions.col").exists());
}

#[test]
fn nobody_misses_files_of_a_job_that_was_done() {
    let parent = tempfile::tempdir().unwrap();
    let path = parent.path().join("work");
    left_over(&path);
    let job = open(&path, Resume::Auto).unwrap();
    job.keep(Step::new(RESULT), [], &1u8).unwrap();
    // As a kill leaves the folder while the job removes it.
    job.retain(&[]).unwrap();
    drop(job);
    let job = open(&path, Resume::Require).unwrap();
    assert_eq!(job.recall::<Vec<u32>>(&SCAN, &()).unwrap(), None);
    assert!(job.take_damage().is_empty());
}

impl WorkFolder {
    /// The encoded value of a recalled step; `None` if it no longer exists.
    pub(crate) fn value_of(&self, key: &StepKey) -> Option<Vec<u8>> {
        match self.recorded(key)?.0.value {
            Value::Here(bytes) => Some(bytes),
            Value::InFile(stamp) => read_value(&self.path.join(stamp.name())).ok(),
        }
    }

    /// Replaces the value of a recalled step, with valid checksums and ids, as an attacker would.
    pub(crate) fn forge(&self, key: &StepKey, value: Vec<u8>) {
        let (record, _) = self.recorded(key).unwrap();
        append(&self.journal, &Entry::Kept(StepRecord { value: Value::Here(value), ..record })).unwrap();
    }
}

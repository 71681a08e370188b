//! The manifest of a job: its inputs and the options that shape its result.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::OpenOptions;
use std::io::Read;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;
use xxhash_rust::xxh3::xxh3_64;

use crate::base::error::{escape, escape_path};
use crate::base::{Error, Result, counted};
use crate::file::codec;
use crate::file::header::{FORMAT_VERSION, HEADER_BYTES, Header};
use crate::os::durable::{DurableFile, folder_of, no_links};

/// Name of the manifest in a work folder.
pub(super) const MANIFEST: &str = "manifest.bin";
/// Largest valid manifest in bytes; 100,000 tiles take a tenth of it.
pub(super) const MANIFEST_BYTES_MAX: u64 = 64 << 20;
/// Largest number of differences that are listed; further ones are counted.
const DIFFERENCES_TOLD_MAX: usize = 12;

/// What a work folder was created for.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Manifest {
    /// Version of the program.
    pub program: String,
    /// The options that shape the result, as a JSON object, or one word for a job without options.
    pub options: String,
    /// The input files, in order.
    pub inputs: Vec<InputFile>,
    /// Number of passes asked for.
    pub passes: u64,
    /// Time when the job began, in seconds since 1970.
    pub began: u64,
    /// Unique id of the job.
    pub job: u64,
    /// Canonical input folders, in which textures may lie, as one list of search paths; empty if only files were given.
    #[serde(with = "codec::path")]
    pub input_folders: PathBuf,
    /// Whether the work folder is removed with the job; false if the user created it.
    pub owns_folder: bool,
}

/// An input file as the job found it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct InputFile {
    /// Name in its canonical folder, since libraries are looked for there.
    #[serde(with = "codec::path")]
    pub path: PathBuf,
    /// Canonical path; textures may lie there, too.
    #[serde(with = "codec::path")]
    pub leads_to: PathBuf,
    /// Length in bytes.
    pub bytes: u64,
}

impl InputFile {
    /// Describes a file.
    ///
    /// # Errors
    /// If it does not exist.
    pub fn of(path: &Path) -> Result<Self> {
        let wrap = |e| Error::io(path, "open", e);
        let bytes = path.metadata().map_err(wrap)?.len();
        let folder = folder_of(path).canonicalize().map_err(wrap)?;
        let leads_to = path.canonicalize().map_err(wrap)?;
        Ok(Self { path: folder.join(path.file_name().unwrap_or_default()), leads_to, bytes })
    }
}

impl Manifest {
    /// Writes the manifest durably; returns its checksum, which identifies its journal.
    ///
    /// # Errors
    /// On a full disk or a failed write.
    pub(super) fn write(&self, path: &Path) -> Result<u64> {
        let bytes = codec::encode(self).map_err(|message| Error::Damaged { path: path.to_owned(), message })?;
        let mut file = DurableFile::create(path, 4096)?;
        file.write(&Self::header(&bytes).encode())?;
        file.write(&bytes)?;
        file.commit()?;
        Ok(xxh3_64(&bytes))
    }

    fn header(content: &[u8]) -> Header {
        Header { kind: *b"manifest", record_bytes: 0, count: 1, checksum: xxh3_64(content) }
    }

    /// Reads a manifest; returns it with its checksum.
    ///
    /// # Errors
    /// [`Error::Changed`] if another version of the format wrote it, [`Error::Damaged`] if it is invalid.
    pub(super) fn read(path: &Path) -> Result<(Self, u64)> {
        let wrap = |e| Error::io(path, "read", e);
        let damaged = |message: &str| Error::Damaged { path: path.to_owned(), message: format!("{message}; {AFRESH}") };
        let mut options = OpenOptions::new();
        let file = no_links(options.read(true)).open(path).map_err(wrap)?;
        if !file.metadata().map_err(wrap)?.is_file() {
            return Err(damaged("it is no regular file"));
        }
        let mut bytes = Vec::new();
        file.take(MANIFEST_BYTES_MAX).read_to_end(&mut bytes).map_err(wrap)?;
        let Some((header, content)) = bytes.split_first_chunk::<{ HEADER_BYTES as usize }>() else {
            return Err(damaged("it is cut short"));
        };
        let decoded = Header::decode(header);
        if let Some(version) = Header::version(header).filter(|version| *version != FORMAT_VERSION) {
            let folder = escape_path(path.parent().unwrap_or(path));
            let message =
                format!("{folder}: made by format {version}, this program has format {FORMAT_VERSION}; {AFRESH}");
            return Err(Error::Changed(message));
        }
        match decoded {
            Ok(header) if header == Self::header(content) => {
                let decoded = codec::decode(content).map_err(|message| damaged(&message))?;
                Ok((decoded, header.checksum))
            }
            Ok(_) => Err(damaged("its checksum does not match")),
            Err(message) => Err(damaged(&message)),
        }
    }

    /// Describes how a new job differs; empty if it is the same job.
    pub(super) fn differences(&self, new: &Self) -> Vec<String> {
        let mut found = Vec::new();
        let mut differ = |what: &str, old: &str, new: &str| {
            if old != new {
                found.push(format!("{what} was {}, is {}", escape(old.as_bytes()), escape(new.as_bytes())));
            }
        };
        differ("the program", &self.program, &new.program);
        let given = |manifest: &Self| {
            if manifest.input_folders.as_os_str().is_empty() {
                "files".to_owned()
            } else {
                format!("in {}", manifest.input_folders.display())
            }
        };
        differ("the input", &given(self), &given(new));
        match (fields(&self.options), fields(&new.options)) {
            (Some(old), Some(new)) => {
                // What the earlier job alone has is a difference, too.
                for name in old.keys().chain(new.keys()).collect::<BTreeSet<_>>() {
                    let [old, new] = [&old, &new].map(|fields| fields.get(name).map_or(NOT_GIVEN, String::as_str));
                    differ(name, old, new);
                }
            }
            _ => differ("the job", &self.options, &new.options),
        }
        let count = |manifest: &Self| counted(manifest.inputs.len() as u64, "file");
        differ("the input", &count(self), &count(new));
        for (old, new) in self.inputs.iter().zip(&new.inputs) {
            differ("an input", &escape_path(&old.path), &escape_path(&new.path));
            if old.path == new.path {
                differ(
                    &format!("what {} leads to", escape_path(&new.path)),
                    &escape_path(&old.leads_to),
                    &escape_path(&new.leads_to),
                );
                let bytes = |input: &InputFile| format!("{} bytes long", input.bytes);
                differ(&escape_path(&new.path), &bytes(old), &bytes(new));
            }
        }
        if found.len() > DIFFERENCES_TOLD_MAX {
            let rest = found.len() - DIFFERENCES_TOLD_MAX;
            found.truncate(DIFFERENCES_TOLD_MAX);
            found.push(format!("{rest} more"));
        }
        found
    }
}

/// Advice for a work folder that cannot be resumed.
pub(super) const AFRESH: &str = "start over with `resume: never`, or give another folder with `work`";

/// Text for an option that was not given.
const NOT_GIVEN: &str = "not given";

/// Options with their values as a user writes them; an option with settings has an entry per setting. `None` if the
/// text is no JSON object.
fn fields(text: &str) -> Option<BTreeMap<String, String>> {
    let Ok(Value::Object(options)) = serde_json::from_str(text) else { return None };
    let mut fields = BTreeMap::new();
    for (name, value) in options {
        if let Value::Object(settings) = &value {
            fields.extend(settings.iter().map(|(setting, value)| (format!("`{name}` ({setting})"), plain(value))));
        }
        fields.insert(format!("`{name}`"), plain(&value));
    }
    Some(fields)
}

fn plain(value: &Value) -> String {
    match value {
        Value::Null => NOT_GIVEN.to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(values) if values.is_empty() => NOT_GIVEN.to_owned(),
        Value::Array(values) => values.iter().map(plain).collect::<Vec<_>>().join(" "),
        Value::Object(_) => "given".to_owned(),
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::ErrorKind;
    use crate::file::header::seal;

    fn manifest(options: &str) -> Manifest {
        let inputs = vec![InputFile { path: "/data/city.obj".into(), leads_to: "/data/city.obj".into(), bytes: 9 }];
        Manifest {
            program: "0.1.0".into(),
            options: options.into(),
            inputs,
            passes: 3,
            began: 1,
            ..Manifest::default()
        }
    }

    #[test]
    fn differences_are_told_in_the_words_of_the_command_line() {
        let old = manifest(
            r#"{"ratio": 0.1, "faces": null, "cluster_faces": 250000, "seams": "stitch", "metric_option": [],
                "remesh": {"lambda": 2.0, "rings": 2}, "pieces": "keep"}"#,
        );
        let mut new = manifest(
            r#"{"ratio": null, "faces": 7, "cluster_faces": 250000, "seams": "lock", "metric_option": ["border=2"],
                "remesh": {"lambda": 3.0, "rings": 2}, "pieces": "keep"}"#,
        );
        new.inputs[0].bytes = 10;
        new.began = 2;
        let expected = [
            "`faces` was not given, is 7",
            "`metric_option` was not given, is border=2",
            "`ratio` was 0.1, is not given",
            "`remesh` (lambda) was 2.0, is 3.0",
            "`seams` was stitch, is lock",
            "/data/city.obj was 9 bytes long, is 10 bytes long",
        ];
        assert_eq!(old.differences(&new), expected);
        assert!(old.differences(&old).is_empty());
        assert_eq!(manifest("compare").differences(&manifest("inspect")), ["the job was compare, is inspect"]);
    }

    #[test]
    fn what_a_forged_manifest_says_is_told_in_a_few_plain_words() {
        let mut old = manifest(r#"{"seams": "\u001b[2J"}"#);
        old.inputs = vec![InputFile { path: "/other\n".into(), leads_to: "/other\n".into(), bytes: 9 }; 1000];
        let mut new = manifest(r#"{"seams": "lock"}"#);
        new.inputs =
            vec![InputFile { path: "/data/city.obj".into(), leads_to: "/data/city.obj".into(), bytes: 9 }; 1000];
        let told = old.differences(&new);
        assert_eq!(told[0], "`seams` was \\u{1b}[2J, is lock");
        assert_eq!(told.len(), DIFFERENCES_TOLD_MAX + 1);
        assert_eq!(told[DIFFERENCES_TOLD_MAX], "989 more");
        assert!(!told.concat().contains(char::is_control));
    }

    #[test]
    fn a_manifest_comes_back_or_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("manifest.bin");
        manifest("{}").write(&path).unwrap();
        assert_eq!(Manifest::read(&path).unwrap().0, manifest("{}"));
        let whole = std::fs::read(&path).unwrap();
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 4;
            std::fs::write(&path, bytes).unwrap();
            let error = Manifest::read(&path).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::Damaged, "byte {at}: {error}");
        }
        let mut other = whole;
        other[16] += 1;
        seal(other.first_chunk_mut().unwrap());
        std::fs::write(&path, other).unwrap();
        assert_eq!(Manifest::read(&path).unwrap_err().kind(), ErrorKind::Changed);
        std::fs::write(&path, b"drystone-job\n").unwrap();
        assert_eq!(Manifest::read(&path).unwrap_err().kind(), ErrorKind::Damaged);
    }
}

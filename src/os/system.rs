//! Memory and disk figures of the system, and positional file access.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether this process runs one job and nothing else.
static IS_CLAIMED: AtomicBool = AtomicBool::new(false);

/// Says that this process runs one job and nothing else: reports then have its peak memory as that of the job. For the
/// `main` of a program; the memory of any other process is not the job's alone, and is left out.
pub fn claim_process() {
    IS_CLAIMED.store(true, Ordering::Relaxed);
}

/// Peak resident memory of this process in bytes (`VmHWM`); `None` if it is unknown, or [not the job's
/// alone](claim_process).
pub fn peak_resident_bytes() -> Option<u64> {
    IS_CLAIMED.load(Ordering::Relaxed).then(|| proc_status_bytes("VmHWM:")).flatten()
}

/// Resident memory of this process in bytes (`VmRSS`); 0 if unknown.
pub fn resident_bytes() -> u64 {
    proc_status_bytes("VmRSS:").unwrap_or(0)
}

/// Bytes that this process has read and written by system calls (`rchar`, `wchar`); 0 if unknown.
pub fn io_bytes() -> (u64, u64) {
    let text = fs::read_to_string("/proc/self/io").unwrap_or_default();
    let field = |name: &str| {
        let line = text.lines().find(|line| line.starts_with(name));
        line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or(0)
    };
    (field("rchar:"), field("wchar:"))
}

/// Memory of the machine or the smallest limit of the process's cgroups, whichever is less, in bytes; `None` if
/// unknown.
pub fn memory_bytes() -> Option<u64> {
    let machine = fs::read_to_string("/proc/meminfo").ok().and_then(|text| kib_field(&text, "MemTotal:"));
    let cgroups = fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let limit = |path: PathBuf| fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let cgroup = limit_files(&cgroups).into_iter().filter_map(limit).min();
    [machine, cgroup].into_iter().flatten().min()
}

/// Files that may contain a memory limit of a process, given its `/proc/self/cgroup`: those of its cgroup and of all
/// its ancestors up to the root that the process sees.
fn limit_files(cgroups: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for line in cgroups.lines() {
        let mut fields = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (fields.next(), fields.next()) else { continue };
        let (root, file) = match controllers {
            "" => ("/sys/fs/cgroup", "memory.max"),
            _ if controllers.split(',').any(|name| name == "memory") => {
                ("/sys/fs/cgroup/memory", "memory.limit_in_bytes")
            }
            _ => continue,
        };
        let path = Path::new(path.trim_start_matches('/'));
        files.extend(path.ancestors().map(|above| Path::new(root).join(above).join(file)));
    }
    files
}

/// Bytes available to this user on the disk of `path`.
///
/// # Errors
/// The error of the system call.
pub fn free_disk_bytes(path: &Path) -> io::Result<u64> {
    fs4::available_space(path)
}

/// Fills `buffer` from an offset of a file. Does not move the file's cursor on Unix.
///
/// # Errors
/// The error of the system call; `UnexpectedEof` if the file is too short.
pub fn read_exact_at(file: &File, buffer: &mut [u8], offset: u64) -> io::Result<()> {
    #[cfg(unix)]
    return std::os::unix::fs::FileExt::read_exact_at(file, buffer, offset);
    #[cfg(windows)]
    {
        let mut done = 0;
        while done < buffer.len() {
            match std::os::windows::fs::FileExt::seek_read(file, &mut buffer[done..], offset + done as u64)? {
                0 => return Err(io::ErrorKind::UnexpectedEof.into()),
                n => done += n,
            }
        }
        Ok(())
    }
}

/// Writes all of `bytes` at an offset of a file.
///
/// # Errors
/// The error of the system call.
pub fn write_all_at(file: &File, bytes: &[u8], offset: u64) -> io::Result<()> {
    #[cfg(unix)]
    return std::os::unix::fs::FileExt::write_all_at(file, bytes, offset);
    #[cfg(windows)]
    {
        let mut done = 0;
        while done < bytes.len() {
            done += std::os::windows::fs::FileExt::seek_write(file, &bytes[done..], offset + done as u64)?;
        }
        Ok(())
    }
}

/// Name of this machine in its network, for messages.
pub fn host_name() -> String {
    #[cfg(unix)]
    return rustix::system::uname().nodename().to_string_lossy().into_owned();
    #[cfg(not(unix))]
    std::env::var("COMPUTERNAME").unwrap_or_default()
}

/// Identifies the running kernel of this machine, where the system tells it; else empty.
pub fn kernel_start() -> String {
    #[cfg(target_os = "linux")]
    return fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default().trim_end().to_owned();
    #[cfg(not(target_os = "linux"))]
    String::new()
}

/// Reports whether an error concerns the machine and not the file, so that the same call may succeed later. That is
/// every system error except those that say that the file does not exist or may not be read.
///
/// After such an error, a file must not be treated as missing.
pub fn is_of_machine(error: &io::Error) -> bool {
    use io::ErrorKind::{InvalidFilename, InvalidInput, IsADirectory, NotADirectory, NotFound, PermissionDenied};
    #[cfg(unix)]
    const OF_NAME: &[i32] = &[libc::ELOOP, libc::EILSEQ];
    #[cfg(not(unix))]
    const OF_NAME: &[i32] = &[];
    let Some(code) = error.raw_os_error() else { return false };
    let tells_of_file = matches!(
        error.kind(),
        NotFound | PermissionDenied | NotADirectory | IsADirectory | InvalidInput | InvalidFilename
    );
    !OF_NAME.contains(&code) && !tells_of_file
}

/// Reports whether a path leads to a regular file.
///
/// # Errors
/// On an error of the machine, which leaves this unknown.
pub fn is_file(path: &Path) -> io::Result<bool> {
    match fs::metadata(path) {
        Err(error) if is_of_machine(&error) => Err(error),
        found => Ok(found.is_ok_and(|meta| meta.is_file())),
    }
}

fn proc_status_bytes(field: &str) -> Option<u64> {
    kib_field(&fs::read_to_string("/proc/self/status").ok()?, field)
}

fn kib_field(text: &str, field: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.starts_with(field))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? << 10)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_counts_at_every_level_above_the_process() {
        let both = limit_files("4:cpu,memory:/jobs/one\n1:name=systemd:/\n0::/user.slice\n");
        let expected = [
            "/sys/fs/cgroup/memory/jobs/one/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/jobs/memory.limit_in_bytes",
            "/sys/fs/cgroup/memory/memory.limit_in_bytes",
            "/sys/fs/cgroup/user.slice/memory.max",
            "/sys/fs/cgroup/memory.max",
        ];
        assert_eq!(both, expected.map(PathBuf::from));
        assert!(limit_files("nonsense").is_empty());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_machine_has_memory() {
        assert!(memory_bytes().is_some_and(|bytes| bytes > resident_bytes()));
    }
}

//! Reports damaged files of a work folder to the user.

use crate::base::Progress;
use crate::job::WorkFolder;

/// Maximum number of damaged files that are listed; of the others only their number is reported.
const DAMAGES_TOLD_MAX: usize = 12;

/// Reports which files were damaged and are recomputed.
pub(super) fn report_damage(job: &WorkFolder, progress: &dyn Progress) {
    let damage = job.take_damage();
    damage.iter().take(DAMAGES_TOLD_MAX).for_each(|damage| progress.tell(damage));
    if let Some(more @ 1..) = damage.len().checked_sub(DAMAGES_TOLD_MAX) {
        progress.tell(&format!("{more} more files are damaged, and done again"));
    }
}

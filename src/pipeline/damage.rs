//! What was found damaged in a work folder, for the user.

use crate::base::Progress;
use crate::job::WorkFolder;

/// Of more damaged files than these it is only told how many there are.
const DAMAGES_TOLD_MAX: usize = 12;

/// Tells what was found damaged and is done again.
pub(super) fn report_damage(job: &WorkFolder, progress: &dyn Progress) {
    let damage = job.take_damage();
    damage.iter().take(DAMAGES_TOLD_MAX).for_each(|damage| progress.tell(damage));
    if let Some(more @ 1..) = damage.len().checked_sub(DAMAGES_TOLD_MAX) {
        progress.tell(&format!("{more} more files are damaged, and done again"));
    }
}

//! The free edge of an image that is filled from the top: how far each column is taken.

/// The skyline of an image.
#[derive(Debug, Clone)]
pub(super) struct Skyline {
    /// Rows taken in each column.
    taken: Vec<u32>,
}

/// What a chart takes of each of its columns: rows from the first to behind the last, counted from its top.
pub(super) type Profile = Vec<[u32; 2]>;

/// A place for a chart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SkylinePlace {
    /// First column.
    pub column: usize,
    /// First row.
    pub row: u32,
}

/// A place that was found: the lower both numbers, the first one first, the better it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct FoundPlace {
    /// Row behind the last one that the chart takes.
    end: u32,
    /// Texels above the chart that nothing can take any more, by the width of a column.
    unused: u64,
    pub place: SkylinePlace,
}

impl Skyline {
    pub fn new(columns: usize) -> Self {
        Self { taken: vec![0; columns] }
    }

    /// Rows that are taken in any column.
    pub fn height(&self) -> u32 {
        self.taken.iter().copied().max().unwrap_or(0)
    }

    /// The place where a chart reaches least far down, within `height` rows; of several, where it leaves least unused.
    pub fn find(&self, profile: &Profile, height: u32) -> Option<FoundPlace> {
        let mut best = None;
        for column in 0..(self.taken.len() + 1).saturating_sub(profile.len()) {
            let below = &self.taken[column..column + profile.len()];
            let row = below.iter().zip(profile).map(|(&taken, &[first, _])| taken.saturating_sub(first)).max()?;
            let end = profile.iter().map(|&[_, end]| row + end).max()?;
            if end > height || best.is_some_and(|(least, _, _)| end > least) {
                continue;
            }
            let unused: u64 =
                below.iter().zip(profile).map(|(&taken, &[first, _])| u64::from(row + first - taken)).sum();
            if best.is_none_or(|(least, wasted, _)| (end, unused) < (least, wasted)) {
                best = Some((end, unused, SkylinePlace { column, row }));
            }
        }
        best.map(|(end, unused, place)| FoundPlace { end, unused, place })
    }

    /// Takes the place for a chart.
    pub fn take(&mut self, profile: &Profile, place: SkylinePlace) {
        for (taken, &[_, end]) in self.taken[place.column..].iter_mut().zip(profile) {
            *taken = place.row + end;
        }
    }
}

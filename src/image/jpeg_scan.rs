//! Reads a JPEG to its last bit without decoding its colours: finds damage that decoders hide.
//!
//! ```text
//! marker, segment, …      tables, size, components
//! start of scan           the codes of all blocks, no bit more, no bit fewer
//! end of image            no byte after it
//! ```
//! Decoders fill what is missing with grey and show what is damaged as other colours. Here, each code must be one of its
//! table, and a scan must end where its last block does. Damage that changes neither the number of the codes nor their
//! lengths is not found. Of a JPEG that is not sequential, only the markers are read.
//!
//! # Memory
//! 8 KiB.
//!
//! # Source
//! ITU-T T.81, annexes B and F.

/// Words on what is wrong with a file.
type JpegFault = &'static str;

const ENDS: JpegFault = "the JPEG ends early";
const DAMAGED: JpegFault = "the codes of the JPEG are damaged";
const UNFIT: JpegFault = "a segment of the JPEG has another length than it says";

/// Components of an image at most.
const COMPONENTS_MAX: usize = 4;
/// Coefficients of a block.
const BLOCK: usize = 64;
/// Bits by which short codes are looked up.
const SHORT_BITS: u32 = 8;

/// Reads a JPEG; returns its width and height.
///
/// # Errors
/// What is wrong with it.
pub fn scan_jpeg(bytes: &[u8]) -> Result<[u32; 2], JpegFault> {
    let mut reader = JpegReader { bytes, at: 0, tables: Default::default(), frame: None, interval: 0 };
    if reader.marker()? != 0xd8 {
        return Err("it is no JPEG");
    }
    let mut is_scanned = false;
    loop {
        match reader.marker()? {
            0xd9 => break,
            0xc4 => reader.read_tables()?,
            0xdd => {
                let &[high, low] = reader.segment()? else { return Err(UNFIT) };
                reader.interval = u16::from_be_bytes([high, low]).into();
            }
            0xda => {
                reader.scan()?;
                is_scanned = true;
            }
            marker @ (0xc0..=0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf) => reader.read_frame(marker)?,
            0x01 | 0xd0..=0xd8 => return Err(DAMAGED),
            _ => _ = reader.segment()?,
        }
    }
    let frame = reader.frame.filter(|_| is_scanned).ok_or("the JPEG holds no pixels")?;
    if reader.at == bytes.len() { Ok(frame.size) } else { Err("bytes follow the JPEG") }
}

/// A component: its name, and how many blocks of it lie beside and below each other in a unit.
#[derive(Clone, Copy, Default)]
struct JpegComponent {
    name: u8,
    blocks: [u32; 2],
}

/// Size and components.
#[derive(Clone, Copy)]
struct JpegFrame {
    size: [u32; 2],
    components: [JpegComponent; COMPONENTS_MAX],
    count: usize,
    /// Whether whole blocks follow each other, in Huffman codes.
    is_sequential: bool,
}

impl JpegFrame {
    fn components(&self) -> &[JpegComponent] {
        &self.components[..self.count]
    }

    /// Units of a scan along an axis: blocks if it has one component.
    fn units(&self, axis: usize, parts: &[ScanPart<'_>]) -> u64 {
        let largest = self.components().iter().map(|own| own.blocks[axis]).max().unwrap_or(1);
        let units = match parts {
            [single] => (self.size[axis] * single.blocks[axis]).div_ceil(largest).div_ceil(8),
            _ => self.size[axis].div_ceil(8 * largest),
        };
        units.into()
    }
}

/// A component in a scan.
struct ScanPart<'a> {
    blocks: [u32; 2],
    /// Codes of the first coefficient of a block, and of the others.
    first: &'a CodeTable,
    others: &'a CodeTable,
}

/// Codes by length, and the symbols that they stand for.
struct CodeTable {
    counts: [u8; 16],
    symbols: [u8; 256],
    /// Length and symbol by the next bits, for short codes; 0 bits for others.
    short: [(u8, u8); 1 << SHORT_BITS],
}

impl CodeTable {
    /// `None` if there are more codes than bits can tell apart.
    fn new(counts: [u8; 16], own: &[u8]) -> Option<Self> {
        let mut table = Self { counts, symbols: [0; 256], short: [(0, 0); 1 << SHORT_BITS] };
        table.symbols.get_mut(..own.len())?.copy_from_slice(own);
        let (mut code, mut at) = (0_u32, 0);
        for (bits, &count) in (1..).zip(&counts) {
            for symbol in &own[at..at + usize::from(count)] {
                if bits <= SHORT_BITS {
                    let rest = SHORT_BITS - bits;
                    table
                        .short
                        .get_mut((code << rest) as usize..((code + 1) << rest) as usize)?
                        .fill((bits as u8, *symbol));
                }
                code += 1;
            }
            if code > 1 << bits {
                return None;
            }
            at += usize::from(count);
            code <<= 1;
        }
        Some(table)
    }
}

struct JpegReader<'a> {
    bytes: &'a [u8],
    at: usize,
    /// For the first coefficients of blocks, and for the others.
    tables: [[Option<CodeTable>; 4]; 2],
    frame: Option<JpegFrame>,
    /// Units between restarts; 0 for none.
    interval: u64,
}

impl<'a> JpegReader<'a> {
    fn marker(&mut self) -> Result<u8, JpegFault> {
        let [start, marker] = *self.bytes[self.at..].first_chunk().ok_or(ENDS)?;
        self.at += 2;
        if start == 0xff { Ok(marker) } else { Err(DAMAGED) }
    }

    fn segment(&mut self) -> Result<&'a [u8], JpegFault> {
        let length = usize::from(u16::from_be_bytes(*self.bytes[self.at..].first_chunk().ok_or(ENDS)?)).max(2);
        let body = self.bytes.get(self.at + 2..self.at + length).ok_or(ENDS)?;
        self.at += length;
        Ok(body)
    }

    fn read_tables(&mut self) -> Result<(), JpegFault> {
        let mut rest = self.segment()?;
        while let Some((&[place, ref counts @ ..], symbols)) = rest.split_first_chunk::<17>() {
            let count = counts.iter().map(|&count| usize::from(count)).sum();
            let (own, after) = symbols.split_at_checked(count).ok_or(UNFIT)?;
            let [class, number] = [place >> 4, place & 15].map(usize::from);
            let slot = self.tables.get_mut(class).and_then(|tables| tables.get_mut(number)).ok_or(DAMAGED)?;
            *slot = Some(CodeTable::new(*counts, own).ok_or(DAMAGED)?);
            rest = after;
        }
        if rest.is_empty() { Ok(()) } else { Err(UNFIT) }
    }

    fn read_frame(&mut self, marker: u8) -> Result<(), JpegFault> {
        let (&[_, y, y_low, x, x_low, count], named) = self.segment()?.split_first_chunk().ok_or(UNFIT)?;
        let count = usize::from(count);
        if self.frame.is_some() || !(1..=COMPONENTS_MAX).contains(&count) || named.len() != 3 * count {
            return Err(DAMAGED);
        }
        let mut components = [JpegComponent::default(); COMPONENTS_MAX];
        for (component, &[name, blocks, _]) in components.iter_mut().zip(named.as_chunks::<3>().0) {
            *component = JpegComponent { name, blocks: [blocks >> 4, blocks & 15].map(u32::from) };
            if component.blocks.iter().any(|blocks| !(1..=4).contains(blocks)) {
                return Err(DAMAGED);
            }
        }
        let size = [[x, x_low], [y, y_low]].map(|side| u16::from_be_bytes(side).into());
        self.frame = Some(JpegFrame { size, components, count, is_sequential: matches!(marker, 0xc0 | 0xc1) });
        Ok(())
    }

    /// Reads a scan, up to the next marker.
    fn scan(&mut self) -> Result<(), JpegFault> {
        let (&count, rest) = self.segment()?.split_first().ok_or(UNFIT)?;
        let named = rest.get(..2 * usize::from(count)).ok_or(UNFIT)?.as_chunks::<2>().0;
        let frame = self.frame.ok_or(DAMAGED)?;
        if !frame.is_sequential {
            return self.pass_over();
        }
        if !(1..=COMPONENTS_MAX).contains(&named.len()) {
            return Err(DAMAGED);
        }
        let part = |&[name, numbers]: &[u8; 2]| {
            let own = frame.components().iter().find(|own| own.name == name)?;
            let table = |class: usize, number: u8| self.tables[class].get(usize::from(number))?.as_ref();
            Some(ScanPart { blocks: own.blocks, first: table(0, numbers >> 4)?, others: table(1, numbers & 15)? })
        };
        let parts: Vec<ScanPart<'_>> = named.iter().map(part).collect::<Option<_>>().ok_or(DAMAGED)?;
        let mut codes = CodeReader { bytes: self.bytes, at: self.at, bits: 0, left: 0 };
        for unit in 0..frame.units(0, &parts) * frame.units(1, &parts) {
            if self.interval > 0 && unit > 0 && unit.is_multiple_of(self.interval) {
                codes.restart((unit / self.interval - 1) as u8 % 8)?;
            }
            for part in &parts {
                let blocks = if parts.len() == 1 { 1 } else { part.blocks[0] * part.blocks[1] };
                (0..blocks).try_for_each(|_| codes.block(part))?;
            }
        }
        self.at = codes.end()?;
        Ok(())
    }

    /// Goes to the next marker that does not belong to the scan.
    fn pass_over(&mut self) -> Result<(), JpegFault> {
        let is_end = |pair: &[u8]| pair[0] == 0xff && !matches!(pair[1], 0 | 0xd0..=0xd7);
        self.at += self.bytes[self.at..].windows(2).position(is_end).ok_or(ENDS)?;
        Ok(())
    }
}

/// Reads the bits of a scan.
struct CodeReader<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Bits that were read and not used, the highest first.
    bits: u64,
    left: u32,
}

impl CodeReader<'_> {
    /// Reads bytes up to a marker, in which a byte of 255 is followed by another one than 0.
    fn fill(&mut self) {
        while self.left <= 56 {
            let Some(&byte) = self.bytes.get(self.at) else { return };
            if byte == 0xff {
                if self.bytes.get(self.at + 1) != Some(&0) {
                    return;
                }
                self.at += 1;
            }
            self.at += 1;
            self.bits |= u64::from(byte) << (56 - self.left);
            self.left += 8;
        }
    }

    fn skip(&mut self, bits: u32) -> Result<(), JpegFault> {
        self.left = self.left.checked_sub(bits).ok_or(ENDS)?;
        self.bits <<= bits;
        Ok(())
    }

    /// The symbol of the next code; another 16 bits are there then, unless the scan ends.
    fn symbol(&mut self, table: &CodeTable) -> Result<u8, JpegFault> {
        if self.left < 32 {
            self.fill();
        }
        let (bits, symbol) = table.short[(self.bits >> (64 - SHORT_BITS)) as usize];
        if bits > 0 {
            self.skip(bits.into())?;
            return Ok(symbol);
        }
        let (mut first, mut at) = (0, 0);
        for (bits, &count) in (1..).zip(&table.counts) {
            let (code, count) = ((self.bits >> (64 - bits)) as u32, u32::from(count));
            if code < first + count {
                self.skip(bits)?;
                return table.symbols.get((at + code - first) as usize).copied().ok_or(DAMAGED);
            }
            at += count;
            first = (first + count) << 1;
        }
        Err(DAMAGED)
    }

    fn block(&mut self, part: &ScanPart<'_>) -> Result<(), JpegFault> {
        let bits = self.symbol(part.first)?;
        if bits > 11 {
            return Err(DAMAGED);
        }
        self.skip(bits.into())?;
        let mut at = 1;
        while at < BLOCK {
            let symbol = self.symbol(part.others)?;
            match (usize::from(symbol >> 4), symbol & 15) {
                (0, 0) => return Ok(()),
                (15, 0) => at += 16,
                (_, 0 | 11..) => return Err(DAMAGED),
                (zeros, bits) => {
                    at += zeros + 1;
                    self.skip(bits.into())?;
                }
            }
        }
        if at == BLOCK { Ok(()) } else { Err(DAMAGED) }
    }

    /// Where the scan ends: what is left is less than a byte.
    fn end(&mut self) -> Result<usize, JpegFault> {
        self.fill();
        if self.left < 8 { Ok(self.at) } else { Err(DAMAGED) }
    }

    fn restart(&mut self, number: u8) -> Result<(), JpegFault> {
        let at = self.end()?;
        if self.bytes.get(at..at + 2) != Some(&[0xff, 0xd0 + number]) {
            return Err(DAMAGED);
        }
        *self = Self { bytes: self.bytes, at: at + 2, bits: 0, left: 0 };
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::image::encode::encode_in_memory;
    use crate::model::image_format::ImageFormat;
    use proptest::prelude::*;

    fn jpeg([width, height]: [usize; 2]) -> Vec<u8> {
        let pixels: Vec<u8> = (0..3 * width * height).map(|at| (at * at / 50) as u8).collect();
        encode_in_memory(&pixels, [width, height], ImageFormat::Jpeg(85), "pixels").unwrap()
    }

    #[test]
    fn whole_files_are_read_to_their_end_and_no_others() {
        for size in [[60, 44], [8, 8], [1, 1], [256, 3]] {
            let file = jpeg(size);
            assert_eq!(scan_jpeg(&file), Ok(size.map(|side| side as u32)));
            for length in 0..file.len() {
                assert!(scan_jpeg(&file[..length]).is_err(), "{length} of {} bytes", file.len());
            }
            assert!(scan_jpeg(&[&file[..], &[0]].concat()).is_err());
        }
    }

    #[test]
    fn pixels_that_are_missing_are_found() {
        let file = jpeg([60, 44]);
        let half = file.len() - 200;
        assert!(scan_jpeg(&[&file[..half], &[0xff, 0xd9]].concat()).is_err());
        let zeros = [&file[..half], &[0; 198], &[0xff, 0xd9]].concat();
        assert!(scan_jpeg(&zeros).is_err());
        assert!(scan_jpeg(&[&[0; 8], &file[8..]].concat()).is_err());
    }

    proptest! {
        #[test]
        fn damaged_files_are_refused_or_read(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..9)) {
            let mut file = jpeg([40, 24]);
            for (at, byte) in changes {
                let at = at.index(file.len());
                file[at] = byte;
            }
            let _ = scan_jpeg(&file);
        }
    }
}

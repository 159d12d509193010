//! The zlib format (RFC 1950, 1951), in which VTK files keep their arrays: read with a bound on what comes out.

/// The contents of a zlib stream, if it is sound and no longer than `limit` bytes.
pub(super) fn zlib(bytes: &[u8], limit: usize) -> Option<Vec<u8>> {
    let [method, flags, body @ ..] = bytes else { return None };
    let header = u32::from(*method) << 8 | u32::from(*flags);
    if method & 15 != 8 || header % 31 != 0 || flags & 32 != 0 {
        return None;
    }
    let mut bits = Bits { bytes: body, at: 0, hold: 0, held: 0 };
    let mut out = Vec::new();
    loop {
        let last = bits.take(1)? == 1;
        match bits.take(2)? {
            0 => stored(&mut bits, &mut out, limit)?,
            1 => compressed(&mut bits, &mut out, limit, &fixed_lengths(), &Huffman::new(&[5; 30])?)?,
            2 => {
                let (lengths, distances) = dynamic_codes(&mut bits)?;
                compressed(&mut bits, &mut out, limit, &lengths, &distances)?;
            }
            _ => return None,
        }
        if last {
            break;
        }
    }
    let sum = body.get(bits.at..bits.at + 4)?;
    (u32::from_be_bytes(sum.try_into().ok()?) == adler32(&out)).then_some(out)
}

fn adler32(bytes: &[u8]) -> u32 {
    let (mut a, mut b) = (1, 0);
    // 5552 bytes are the most whose sums fit into 32 bits.
    for chunk in bytes.chunks(5552) {
        for &byte in chunk {
            a += u32::from(byte);
            b += a;
        }
        (a, b) = (a % 65521, b % 65521);
    }
    b << 16 | a
}

struct Bits<'a> {
    bytes: &'a [u8],
    at: usize,
    hold: u32,
    held: u32,
}

impl Bits<'_> {
    /// The next bits, the first the lowest; at most 16.
    fn take(&mut self, count: u32) -> Option<u32> {
        while self.held < count {
            self.hold |= u32::from(*self.bytes.get(self.at)?) << self.held;
            self.at += 1;
            self.held += 8;
        }
        let value = self.hold & ((1 << count) - 1);
        self.hold >>= count;
        self.held -= count;
        Some(value)
    }
}

/// A canonical code: how many codes there are of each length, and the symbols in order of their codes.
struct Huffman {
    counts: [u16; 16],
    symbols: Vec<u16>,
}

impl Huffman {
    /// From the length of each symbol's code, 0 for none; none at all if the lengths promise too many codes.
    fn new(lengths: &[u8]) -> Option<Self> {
        let mut counts = [0u16; 16];
        for &length in lengths {
            *counts.get_mut(length as usize)? += 1;
        }
        counts[0] = 0;
        let mut room = 1i32;
        for &count in &counts[1..] {
            room = 2 * room - i32::from(count);
            if room < 0 {
                return None;
            }
        }
        let mut symbols: Vec<u16> = (0..lengths.len() as u16).filter(|&s| lengths[s as usize] > 0).collect();
        symbols.sort_by_key(|&s| lengths[s as usize]);
        Some(Huffman { counts, symbols })
    }

    fn symbol(&self, bits: &mut Bits) -> Option<u16> {
        let (mut code, mut first, mut index) = (0, 0, 0);
        for &count in &self.counts[1..] {
            code |= bits.take(1)?;
            let count = u32::from(count);
            if code - first < count {
                return self.symbols.get((index + code - first) as usize).copied();
            }
            index += count;
            first = (first + count) << 1;
            code <<= 1;
        }
        None
    }
}

fn fixed_lengths() -> Huffman {
    let mut counts = [0; 16];
    (counts[7], counts[8], counts[9]) = (24, 152, 112);
    let symbols = (256..280).chain(0..144).chain(280..288).chain(144..256).collect();
    Huffman { counts, symbols }
}

fn dynamic_codes(bits: &mut Bits) -> Option<(Huffman, Huffman)> {
    const ORDER: [usize; 19] = [16, 17, 18, 0, 8, 7, 9, 6, 10, 5, 11, 4, 12, 3, 13, 2, 14, 1, 15];
    let lengths = bits.take(5)? as usize + 257;
    let distances = bits.take(5)? as usize + 1;
    let codes = bits.take(4)? as usize + 4;
    let mut code_lengths = [0; 19];
    for &place in &ORDER[..codes] {
        code_lengths[place] = bits.take(3)? as u8;
    }
    let code = Huffman::new(&code_lengths)?;
    let mut all = Vec::new();
    while all.len() < lengths + distances {
        let (value, repeat) = match code.symbol(bits)? {
            16 => (*all.last()?, 3 + bits.take(2)?),
            17 => (0, 3 + bits.take(3)?),
            18 => (0, 11 + bits.take(7)?),
            length => (length as u8, 1),
        };
        all.extend(std::iter::repeat_n(value, repeat as usize));
    }
    let (lengths, distances) = all.get(..lengths + distances)?.split_at(lengths);
    Some((Huffman::new(lengths)?, Huffman::new(distances)?))
}

fn stored(bits: &mut Bits, out: &mut Vec<u8>, limit: usize) -> Option<()> {
    // What is held of the last byte is filling.
    (bits.hold, bits.held) = (0, 0);
    let [a, b, c, d, ..] = *bits.bytes.get(bits.at..)? else { return None };
    let length = usize::from(u16::from_le_bytes([a, b]));
    if u16::from_le_bytes([c, d]) != !(length as u16) || out.len() + length > limit {
        return None;
    }
    out.extend_from_slice(bits.bytes.get(bits.at + 4..bits.at + 4 + length)?);
    bits.at += 4 + length;
    Some(())
}

fn compressed(
    bits: &mut Bits,
    out: &mut Vec<u8>,
    limit: usize,
    lengths: &Huffman,
    distances: &Huffman,
) -> Option<()> {
    const LENGTH: [u16; 29] = [
        3, 4, 5, 6, 7, 8, 9, 10, 11, 13, 15, 17, 19, 23, 27, 31, 35, 43, 51, 59, 67, 83, 99, 115, 131, 163,
        195, 227, 258,
    ];
    const LENGTH_BITS: [u8; 29] =
        [0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 0];
    const DISTANCE: [u16; 30] = [
        1, 2, 3, 4, 5, 7, 9, 13, 17, 25, 33, 49, 65, 97, 129, 193, 257, 385, 513, 769, 1025, 1537, 2049,
        3073, 4097, 6145, 8193, 12289, 16385, 24577,
    ];
    loop {
        let symbol = usize::from(lengths.symbol(bits)?);
        if symbol == 256 {
            return Some(());
        }
        let copied = match symbol.checked_sub(257) {
            None => 1,
            Some(i) => usize::from(*LENGTH.get(i)?) + bits.take(u32::from(LENGTH_BITS[i]))? as usize,
        };
        if out.len() + copied > limit {
            return None;
        }
        if symbol < 256 {
            out.push(symbol as u8);
            continue;
        }
        let i = usize::from(distances.symbol(bits)?);
        let distance = usize::from(*DISTANCE.get(i)?) + bits.take((i as u32 / 2).saturating_sub(1))? as usize;
        let start = out.len().checked_sub(distance)?;
        for from in start..start + copied {
            out.push(out[from]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::zlib;

    #[test]
    fn the_three_kinds_of_blocks_are_read_up_to_the_limit() {
        let stored = b"\x78\x01\x01\x05\x00\xfa\xffhello\x06\x2c\x02\x15";
        let fixed = b"\x78\x9c\xcb\x48\xcd\xc9\xc9\x07\x00\x06\x2c\x02\x15";
        let dynamic = b"\x78\xda\xed\xcc\x31\x0e\xc0\x40\x08\x03\xc1\xb7\x1a\x23\x38\xcc\xff\xfb\x5c\xa4\xbc\x21\x95\xb7\
            \x5e\x0d\x80\x60\xd6\x11\xb2\xc5\xde\x1c\x1e\x4e\xaa\x62\x8a\x7b\x2a\x03\xab\xb9\x69\x11\xf7\x5b\
            \xd6\x44\xe9\xdb\xb6\xa9\x4e\xe8\x7e\x0c\xbc\x19\x33\x66\xcc\x98\x31\x63\xc6\xfe\xc7\x1e\xa7\xd6\
            \x1b\xfa";
        assert_eq!(zlib(stored, 5).unwrap(), b"hello");
        assert_eq!(zlib(fixed, 5).unwrap(), b"hello");
        let expected: Vec<u8> = (0..2000u32).map(|i| (i * i / 7 % 11) as u8 + b'a').collect();
        assert_eq!(zlib(dynamic, 2000).unwrap(), expected);
        assert_eq!(zlib(stored, 4), None);
        assert_eq!(zlib(fixed, 4), None);
        assert_eq!(zlib(dynamic, 1999), None);
        for cut in 0..dynamic.len() {
            assert_eq!(zlib(&dynamic[..cut], 2000), None);
        }
    }
}

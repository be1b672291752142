//! Conversion of arbitrary bytes to numbers.

/// Remaining bytes of an input, followed by zeros.
pub struct Bytes<'a>(pub &'a [u8]);

/// Numbers that often break code, such as NaN and subnormals.
const ODD: [f32; 12] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    0.0,
    -0.0,
    f32::MIN_POSITIVE,
    1e-45,
    f32::MAX,
    f32::MIN,
    1e-20,
    1e20,
    -1.0,
];

impl Bytes<'_> {
    /// True at the end of the input.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Takes the next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// Takes the next byte; true if it is odd.
    pub fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    /// Takes a number: mostly sixteenths from 0 to 12, some of [`ODD`], some with arbitrary bits.
    pub fn number(&mut self) -> f32 {
        match self.byte() {
            code @ 0..200 => f32::from(code) / 16.0,
            code @ 200..212 => ODD[usize::from(code - 200)],
            212..240 => -f32::from(self.byte()) / 64.0,
            _ => f32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()]),
        }
    }
}

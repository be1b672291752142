//! Arbitrary bytes as the numbers that programs are handed.

/// What is left of the input; behind its end there are zeros.
pub struct Bytes<'a>(pub &'a [u8]);

/// Numbers that break what was only thought of for others.
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
    /// Whether nothing is left.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The next byte.
    pub fn byte(&mut self) -> u8 {
        let Some((first, rest)) = self.0.split_first() else { return 0 };
        self.0 = rest;
        *first
    }

    /// Whether the next byte is odd.
    pub fn flag(&mut self) -> bool {
        self.byte() & 1 == 1
    }

    /// A number: most are everyday ones, sixteenths from 0 to 12, some odd, some any that there are.
    pub fn number(&mut self) -> f32 {
        match self.byte() {
            code @ 0..200 => f32::from(code) / 16.0,
            code @ 200..212 => ODD[usize::from(code - 200)],
            212..240 => -f32::from(self.byte()) / 64.0,
            _ => f32::from_le_bytes([self.byte(), self.byte(), self.byte(), self.byte()]),
        }
    }
}

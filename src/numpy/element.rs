//! The element types of arrays, and what Rust type reads which.

/// The element types that are read and written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Element {
    Bool,
    U8,
    I32,
    F32,
    F64,
}

impl Element {
    pub(super) const ALL: [Self; 5] = [Self::Bool, Self::U8, Self::I32, Self::F32, Self::F64];

    /// The type string of the header.
    pub fn descr(self) -> &'static str {
        match self {
            Self::Bool => "|b1",
            Self::U8 => "|u1",
            Self::I32 => "<i4",
            Self::F32 => "<f4",
            Self::F64 => "<f8",
        }
    }

    /// Bytes of one element.
    pub fn bytes(self) -> usize {
        match self {
            Self::Bool | Self::U8 => 1,
            Self::I32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A Rust type that array elements are read into and written from.
pub trait Value: Copy {
    /// The element type that it is written as.
    const ELEMENT: Element;
    /// Decodes one little-endian element; `None` where the conversion would surprise.
    fn decode(element: Element, bytes: &[u8]) -> Option<Self>;
    /// Appends the little-endian bytes.
    fn encode(self, out: &mut Vec<u8>);
}

impl Value for f32 {
    const ELEMENT: Element = Element::F32;
    #[inline]
    fn decode(element: Element, bytes: &[u8]) -> Option<Self> {
        match element {
            Element::F32 => Some(Self::from_le_bytes(bytes.try_into().ok()?)),
            Element::F64 => Some(f64::from_le_bytes(bytes.try_into().ok()?) as Self),
            Element::Bool | Element::U8 | Element::I32 => None,
        }
    }
    #[inline]
    fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

impl Value for bool {
    const ELEMENT: Element = Element::Bool;
    #[inline]
    fn decode(element: Element, bytes: &[u8]) -> Option<Self> {
        match (element, bytes) {
            (Element::Bool | Element::U8, [byte]) => Some(*byte != 0),
            _ => None,
        }
    }
    #[inline]
    fn encode(self, out: &mut Vec<u8>) {
        out.push(u8::from(self));
    }
}

impl Value for u8 {
    const ELEMENT: Element = Element::U8;
    #[inline]
    fn decode(element: Element, bytes: &[u8]) -> Option<Self> {
        match (element, bytes) {
            (Element::Bool | Element::U8, [byte]) => Some(*byte),
            _ => None,
        }
    }
    #[inline]
    fn encode(self, out: &mut Vec<u8>) {
        out.push(self);
    }
}

impl Value for i32 {
    const ELEMENT: Element = Element::I32;
    #[inline]
    fn decode(element: Element, bytes: &[u8]) -> Option<Self> {
        match (element, bytes) {
            (Element::I32, _) => Some(Self::from_le_bytes(bytes.try_into().ok()?)),
            (Element::Bool | Element::U8, [byte]) => Some(Self::from(*byte)),
            _ => None,
        }
    }
    #[inline]
    fn encode(self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.to_le_bytes());
    }
}

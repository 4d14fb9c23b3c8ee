//! A tiny ONNX file, field by field, for tests that need a network with a known answer.

/// The network of two arrays of equal shape whose one output is the mean of |a - b|.
pub(crate) fn mean_difference() -> Vec<u8> {
    let keep_no_dimensions = [text(1, "keepdims"), number(3, 0), number(20, 2)].concat();
    let graph = [
        node("Sub", &["a", "b"], "difference", &[]),
        node("Abs", &["difference"], "distance", &[]),
        node("ReduceMean", &["distance"], "mean", &part(5, &keep_no_dimensions)),
        text(2, "mean_difference"),
        part(11, &array("a")),
        part(11, &array("b")),
        part(12, &array("mean")),
    ];
    let operators = [text(1, ""), number(2, 13)].concat();
    [number(1, 7), part(7, &graph.concat()), part(8, &operators)].concat()
}

/// `GraphProto.node`.
fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[u8]) -> Vec<u8> {
    let inputs: Vec<u8> = inputs.iter().flat_map(|name| text(1, name)).collect();
    let named = [text(2, output), text(4, operator)].concat();
    part(1, &[&inputs[..], &named, attributes].concat())
}

/// `ValueInfoProto` of a float array whose shape is not told.
fn array(name: &str) -> Vec<u8> {
    let float = part(1, &number(1, 1));
    [text(1, name), part(2, &float)].concat()
}

/// A field of wire type 0; every number here is below 128.
fn number(field: u8, value: u8) -> Vec<u8> {
    [key(field, 0), vec![value]].concat()
}

fn text(field: u8, value: &str) -> Vec<u8> {
    part(field, value.as_bytes())
}

/// A field of wire type 2, up to 16383 bytes.
fn part(field: u8, bytes: &[u8]) -> Vec<u8> {
    let length = bytes.len();
    let length = match length {
        0..128 => vec![length as u8],
        _ => vec![(length & 127) as u8 | 128, (length >> 7) as u8],
    };
    [key(field, 2), length, bytes.to_vec()].concat()
}

fn key(field: u8, wire_type: u8) -> Vec<u8> {
    let key = u16::from(field) << 3 | u16::from(wire_type);
    if key < 128 { vec![key as u8] } else { vec![(key & 127) as u8 | 128, (key >> 7) as u8] }
}

//! Tiny ONNX files, field by field, for tests that need a network with a known answer.

/// The network of two arrays of equal shape whose one output is the mean of |a - b|.
pub(crate) fn mean_difference() -> Vec<u8> {
    let graph = [
        node("Sub", &["a", "b"], "difference", &[]),
        node("Abs", &["difference"], "distance", &[]),
        node("ReduceMean", &["distance"], "mean", &keep_no_dimensions()),
        text(2, "mean_difference"),
        part(11, &floats("a")),
        part(11, &floats("b")),
        part(12, &floats("mean")),
    ];
    model(&graph.concat())
}

/// A text tower that looks each token up in `rows` (of `width` numbers): the inputs that are named,
/// of which the first is the tokens and the rest go unused, and two outputs: `states`, one row a
/// token, and `pooled`, their plain mean.
pub(crate) fn token_rows(inputs: &[&str], outputs: [&str; 2], rows: &[f32], width: u8) -> Vec<u8> {
    let [states, pooled] = outputs;
    let data: Vec<u8> = rows.iter().flat_map(|value| value.to_le_bytes()).collect();
    let count = (rows.len() / usize::from(width)) as u8;
    let table =
        [number(1, count), number(1, width), number(2, 1), text(8, "table"), part(9, &data)];
    let over_tokens = [text(1, "axes"), number(8, 1), number(20, 7)].concat();
    let mean = [part(5, &over_tokens), keep_no_dimensions()].concat();
    let graph = [
        node("Gather", &["table", inputs[0]], states, &[]),
        node("ReduceMean", &[states], pooled, &mean),
        text(2, "token_rows"),
        part(5, &table.concat()),
        inputs.iter().flat_map(|name| part(11, &whole_numbers(name))).collect(),
        part(12, &floats(states)),
        part(12, &floats(pooled)),
    ];
    model(&graph.concat())
}

/// `ModelProto` of a graph.
fn model(graph: &[u8]) -> Vec<u8> {
    let operators = [text(1, ""), number(2, 13)].concat();
    [number(1, 7), part(7, graph), part(8, &operators)].concat()
}

/// An attribute of `ReduceMean`.
fn keep_no_dimensions() -> Vec<u8> {
    part(5, &[text(1, "keepdims"), number(3, 0), number(20, 2)].concat())
}

/// `GraphProto.node`.
fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[u8]) -> Vec<u8> {
    let inputs: Vec<u8> = inputs.iter().flat_map(|name| text(1, name)).collect();
    let named = [text(2, output), text(4, operator)].concat();
    part(1, &[&inputs[..], &named, attributes].concat())
}

/// `ValueInfoProto` of a float array whose shape is not told.
fn floats(name: &str) -> Vec<u8> {
    array(name, 1)
}

/// The same of 64-bit integers.
fn whole_numbers(name: &str) -> Vec<u8> {
    array(name, 7)
}

fn array(name: &str, element: u8) -> Vec<u8> {
    let tensor = part(1, &number(1, element));
    [text(1, name), part(2, &tensor)].concat()
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

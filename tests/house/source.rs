//! Rust source as tokens, and the crate-level paths in it, without a compiler.

/// A word or a punctuation character, with its line (from 1). Comments and literals are left out,
/// so that nothing said in them counts.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Token<'a> {
    pub(crate) text: &'a str,
    pub(crate) line: usize,
}

/// The tokens of `source`. `::` is one token.
pub(crate) fn tokens(source: &str) -> Vec<Token<'_>> {
    let mut tokens = Vec::new();
    let (mut rest, mut line) = (source, 1);
    while let Some(first) = rest.chars().next() {
        let word =
            rest.len() - rest.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_').len();
        let length = if let Some(length) = comment(rest).or_else(|| literal(rest)) {
            length
        } else if word > 0 {
            tokens.push(Token { text: &rest[..word], line });
            word
        } else if rest.starts_with("::") {
            tokens.push(Token { text: "::", line });
            2
        } else {
            let length = first.len_utf8();
            if !first.is_whitespace() {
                tokens.push(Token { text: &rest[..length], line });
            }
            length
        };
        line += rest[..length].matches('\n').count();
        rest = &rest[length..];
    }
    tokens
}

/// The length of the comment that `text` starts with. Block comments nest.
fn comment(text: &str) -> Option<usize> {
    if text.starts_with("//") {
        return Some(text.find('\n').unwrap_or(text.len()));
    }
    if !text.starts_with("/*") {
        return None;
    }
    let (mut depth, mut at) = (1, 2);
    while depth > 0 && at < text.len() {
        let rest = &text.as_bytes()[at..];
        depth += i32::from(rest.starts_with(b"/*")) - i32::from(rest.starts_with(b"*/"));
        at += if rest.starts_with(b"/*") || rest.starts_with(b"*/") { 2 } else { 1 };
    }
    Some(at)
}

/// The length of the string, character or lifetime that `text` starts with.
fn literal(text: &str) -> Option<usize> {
    let prefix = text.len() - text.trim_start_matches(['b', 'r', 'c']).len();
    let (prefix, after) = if prefix <= 2 { text.split_at(prefix) } else { ("", text) };
    if prefix.ends_with('r') {
        let hashes = after.len() - after.trim_start_matches('#').len();
        if after[hashes..].starts_with('"') {
            let close = format!("\"{}", &after[..hashes]);
            let body = &after[hashes + 1..];
            let length = body.find(&close).map_or(body.len(), |end| end + close.len());
            return Some(prefix.len() + hashes + 1 + length);
        }
        return None;
    }
    if after.starts_with('"') {
        return Some(prefix.len() + quoted(after, '"'));
    }
    if after.starts_with('\'') && matches!(prefix, "" | "b") {
        let mut inner = after.chars().skip(1);
        let (first, second) = (inner.next(), inner.next());
        let is_char = first == Some('\\') || second == Some('\'');
        // A lifetime's name follows as a word, which names nothing.
        return Some(prefix.len() + if is_char { quoted(after, '\'') } else { 1 });
    }
    None
}

/// The length of `text` up to the closing `quote`, escapes skipped.
fn quoted(text: &str, quote: char) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        if c == quote && !escaped {
            return at + 1;
        }
        escaped = c == '\\' && !escaped;
    }
    text.len()
}

/// A path from the crate's root: the first name after it.
#[derive(Debug, PartialEq)]
pub(crate) struct Import<'a> {
    pub(crate) name: &'a str,
    pub(crate) line: usize,
}

/// Every path in `tokens` that starts at the root of the crate: `crate::x`, enough `super`s, and
/// `orenx::x` in the program's own root. `depth` is how many modules the file is below the root
/// (`a/b.rs` is 2).
pub(crate) fn imports<'a>(tokens: &[Token<'a>], depth: usize) -> Vec<Import<'a>> {
    let mut found = Vec::new();
    let mut braces = Vec::new();
    let text = |at: usize| tokens.get(at).map_or("", |token| token.text);
    for at in 0..tokens.len() {
        match text(at) {
            // `mod name {` is one level more for the `super`s within it.
            "{" => braces.push(at >= 2 && text(at - 2) == "mod"),
            "}" => drop(braces.pop()),
            "crate" if text(at + 1) == "::" => names(&tokens[at + 2..], &mut found),
            "orenx" if depth == 0 && text(at + 1) == "::" => {
                names(&tokens[at + 2..], &mut found);
            }
            // The root under another name.
            "crate" if text(at + 1) == "as" => found.extend(first(&tokens[at..])),
            "super" if at < 2 || text(at - 2) != "super" => {
                let supers = (at..).step_by(2).take_while(|&i| text(i) == "super").count();
                let level = depth + braces.iter().filter(|is_module| **is_module).count();
                // `pub(super)` ends in no path.
                if supers >= level && text(at + 2 * supers - 1) == "::" {
                    names(&tokens[at + 2 * supers..], &mut found);
                }
            }
            _ => {}
        }
    }
    found
}

fn first<'a>(tokens: &[Token<'a>]) -> Option<Import<'a>> {
    tokens.first().map(|token| Import { name: token.text, line: token.line })
}

/// The first names of the path, or of the group of paths, that `tokens` start with.
fn names<'a>(tokens: &[Token<'a>], found: &mut Vec<Import<'a>>) {
    if tokens.first().is_none_or(|token| token.text != "{") {
        found.extend(first(tokens));
        return;
    }
    let (mut depth, mut starts) = (0, false);
    for (at, token) in tokens.iter().enumerate() {
        match token.text {
            "{" => depth += 1,
            "}" => depth -= 1,
            _ if depth == 1 && starts => found.extend(first(&tokens[at..])),
            _ => {}
        }
        if depth == 0 {
            return;
        }
        starts = depth == 1 && matches!(token.text, "{" | ",");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(source: &str, depth: usize) -> Vec<(String, usize)> {
        imports(&tokens(source), depth).into_iter().map(|i| (i.name.to_owned(), i.line)).collect()
    }

    #[test]
    fn every_way_to_the_root_is_found() {
        let source = "use crate::map::View;\n\
            use crate::{error::{Error, Result}, frame,\n geometry::*};\n\
            fn f() { crate::serve::run(super::super::wire::x); }\n\
            use crate as c;\n\
            mod tests { use super::*; use super::super::super::cli; }\n\
            macro_rules! m { () => { $crate::eval::y } }\n";
        let expected = [
            ("map", 1),
            ("error", 2),
            ("frame", 2),
            ("geometry", 3),
            ("serve", 4),
            ("wire", 4),
            ("crate", 5),
            ("cli", 6),
            ("eval", 7),
        ];
        assert_eq!(found(source, 2), expected.map(|(name, line)| (name.to_owned(), line)));
        assert_eq!(found("use super::map;", 1), [("map".to_owned(), 1)]);
        assert_eq!(found("use super::map;", 2), []);
        assert_eq!(found("pub(super) fn f() {} pub(crate) fn g() {}", 1), []);
        assert_eq!(found("orenx::cli::run()", 0), [("cli".to_owned(), 1)]);
    }

    #[test]
    fn what_is_only_said_does_not_count() {
        let source = "// crate::a\n/* crate::b /* */ crate::c */ \"crate::d \\\" crate::e\"\n\
            r#\"crate::f \"crate::g\"# b\"crate::h\" '\\'' 'c' b'\"' &'a str crate::found";
        assert_eq!(found(source, 1), [("found".to_owned(), 3)]);
        let words: Vec<_> =
            tokens("bring(r#type, x's')").iter().map(|t| t.text.to_owned()).collect();
        assert_eq!(words.concat(), "bring(r#type,x)");
    }
}

//! The report: tables in Markdown and in HTML, with the best of each column marked.

use std::fmt::Write;
use std::ops::Range;

use super::chart::{Series, chart};

/// Which of a column's values is the best.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Better {
    Higher,
    Lower,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Column {
    name: String,
    better: Better,
    digits: usize,
}

impl Column {
    pub(super) fn new(name: &str, better: Better, digits: usize) -> Self {
        Self { name: name.into(), better, digits }
    }
}

/// A variant and its values, one a column; NaN where there is none.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Row {
    name: String,
    values: Vec<f64>,
}

impl Row {
    pub(super) fn new(name: &str, values: Vec<f64>) -> Self {
        Self { name: name.into(), values }
    }
}

/// What was varied, and what came of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    /// Of its plot, without an ending.
    pub(super) file: &'static str,
    pub(super) title: &'static str,
    pub(super) note: &'static str,
    pub(super) columns: Vec<Column>,
    pub(super) rows: Vec<Row>,
    /// The columns that the plot shows.
    pub(super) charted: Range<usize>,
}

impl Table {
    /// A value as it is printed, and whether it is the best of its column.
    fn cell(&self, row: usize, column: usize) -> (String, bool) {
        let Column { better, digits, .. } = self.columns[column];
        let value = self.rows[row].values[column];
        if !value.is_finite() {
            return ("–".to_owned(), false);
        }
        let text = |value: f64| format!("{value:.digits$}");
        let values = self.rows.iter().map(|row| row.values[column]).filter(|v| v.is_finite());
        let best = match better {
            Better::Higher => values.fold(f64::NEG_INFINITY, f64::max),
            Better::Lower => values.fold(f64::INFINITY, f64::min),
        };
        let shown = text(value);
        // As it is printed: ties are ties.
        let is_best = shown == text(best) && self.rows.len() > 1;
        (shown, is_best)
    }

    /// Columns that say something.
    fn shown(&self) -> Vec<usize> {
        let says = |&c: &usize| self.rows.iter().any(|row| row.values[c].is_finite());
        (0..self.columns.len()).filter(says).collect()
    }

    fn chart(&self) -> String {
        let charted = &self.columns[self.charted.clone()];
        let groups: Vec<&str> = charted.iter().map(|column| column.name.as_str()).collect();
        let series = self.rows.iter().map(|row| Series {
            name: &row.name,
            values: row.values[self.charted.clone()].to_vec(),
        });
        chart(&groups, &series.collect::<Vec<_>>())
    }

    fn markdown(&self) -> String {
        let shown = self.shown();
        let mut text = format!("## {}\n\n{}\n\n|", self.title, self.note);
        shown.iter().for_each(|&c| text += &format!(" | {}", self.columns[c].name));
        text += " |\n|---";
        shown.iter().for_each(|_| text += "|---:");
        text += "|\n";
        for (r, row) in self.rows.iter().enumerate() {
            text += &format!("| {}", row.name);
            for &c in &shown {
                let (value, is_best) = self.cell(r, c);
                text += &if is_best { format!(" | **{value}**") } else { format!(" | {value}") };
            }
            text += " |\n";
        }
        text + &format!("\n![{}]({}.svg)\n", self.title, self.file)
    }

    fn html(&self) -> String {
        let shown = self.shown();
        let mut text = format!("<h2>{}</h2>\n<p>{}</p>\n", self.title, escaped(self.note));
        text += "<table>\n<tr><th></th>";
        for &c in &shown {
            text += &format!("<th>{}</th>", escaped(&self.columns[c].name));
        }
        text += "</tr>\n";
        for (r, row) in self.rows.iter().enumerate() {
            text += &format!("<tr><td>{}</td>", escaped(&row.name));
            for &c in &shown {
                let (value, is_best) = self.cell(r, c);
                let class = if is_best { " class=\"best\"" } else { "" };
                text += &format!("<td{class}>{value}</td>");
            }
            text += "</tr>\n";
        }
        text + "</table>\n" + &self.chart() + "\n"
    }
}

/// All of it.
#[derive(Debug)]
pub(super) struct Page {
    about: String,
    tables: Vec<Table>,
}

const TITLE: &str = "What each part is worth";
const STYLE: &str = "body{font:16px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;\
padding:0 1rem;color:#26282e}table{border-collapse:collapse;margin:1rem 0}th,td{padding:.25rem .75rem;\
border-bottom:1px solid #dcdcd8;text-align:right}td:first-child{text-align:left}\
td.best{font-weight:700;background:#e6f2e6}svg{max-width:100%;height:auto}";

impl Page {
    pub(super) fn new(about: String) -> Self {
        Self { about, tables: Vec::new() }
    }

    pub(super) fn push(&mut self, table: Table) {
        self.tables.push(table);
    }

    /// The plots and the names of their files.
    pub(super) fn charts(&self) -> impl Iterator<Item = (String, String)> {
        self.tables.iter().map(|table| (format!("{}.svg", table.file), table.chart()))
    }

    pub(super) fn markdown(&self) -> String {
        let mut text = format!("# {TITLE}\n\n{}\n", self.about);
        for table in &self.tables {
            // Writing to a string cannot fail.
            let _ = write!(text, "\n{}", table.markdown());
        }
        text
    }

    /// A page that needs nothing beside it.
    pub(super) fn html(&self) -> String {
        let tables: String = self.tables.iter().map(Table::html).collect();
        format!(
            "<!doctype html>\n<html lang=\"en\">\n<meta charset=\"utf-8\">\n<title>{TITLE}</title>\n\
             <style>{STYLE}</style>\n<h1>{TITLE}</h1>\n<p>{}</p>\n{tables}</html>\n",
            escaped(&self.about)
        )
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        Table {
            file: "noise",
            title: "Noise",
            note: "a < b.",
            columns: vec![
                Column::new("PSNR", Better::Higher, 1),
                Column::new("LPIPS", Better::Lower, 2),
                Column::new("mm", Better::Lower, 1),
            ],
            rows: vec![
                Row::new("ray", vec![30.04, f64::NAN, 3.0]),
                Row::new("tile", vec![29.96, f64::NAN, f64::NAN]),
                Row::new("old & slow", vec![28.0, f64::NAN, 4.0]),
            ],
            charted: 0..1,
        }
    }

    #[test]
    fn markdown_marks_the_best_and_leaves_out_what_says_nothing() {
        let mut page = Page::new("office.".into());
        page.push(table());
        let text = page.markdown();
        assert!(text.starts_with("# What each part is worth\n\noffice.\n\n## Noise\n"), "{text}");
        let lines: Vec<&str> = text.lines().filter(|line| line.starts_with('|')).collect();
        let expected = [
            "| | PSNR | mm |",
            "|---|---:|---:|",
            "| ray | **30.0** | **3.0** |",
            "| tile | **30.0** | – |",
            "| old & slow | 28.0 | 4.0 |",
        ];
        assert_eq!(lines, expected);
        assert!(text.ends_with("![Noise](noise.svg)\n"), "{text}");
    }

    #[test]
    fn html_stands_alone_and_is_escaped() {
        let mut page = Page::new("x < y".into());
        page.push(table());
        let text = page.html();
        for part in
            ["x &lt; y", "a &lt; b.", "old &amp; slow", "<td class=\"best\">3.0</td>", "<svg"]
        {
            assert!(text.contains(part), "{part} in {text}");
        }
        assert!(!text.contains("LPIPS") && !text.contains("src="), "{text}");
        let charts: Vec<_> = page.charts().collect();
        assert_eq!((charts.len(), charts[0].0.as_str()), (1, "noise.svg"));
    }
}

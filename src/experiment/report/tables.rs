//! Tables of a page: a row of headings that sort, and cells.

use std::fmt::Write;

use crate::record::{Column, Table, Values};

use super::MOST_ROWS;
use super::page::escaped;

/// A table as HTML; of a long one the first rows.
pub(super) fn html(table: &Table) -> String {
    let mut html = String::from("<div class=\"scroll\"><table>\n<thead><tr>");
    for column in table.columns() {
        let unit = match column.unit.as_str() {
            "" => String::new(),
            unit => format!(" <small>{}</small>", escaped(unit)),
        };
        let _infallible = write!(
            html,
            "<th scope=\"col\"><button type=\"button\">{}{unit}</button></th>",
            escaped(&column.name)
        );
    }
    html += "</tr></thead>\n<tbody>\n";
    let rows = table.row_count();
    for row in 0..rows.min(MOST_ROWS) {
        html += "<tr>";
        table.columns().iter().for_each(|column| html += &cell(column, row));
        html += "</tr>\n";
    }
    html += "</tbody></table></div>\n";
    if rows > MOST_ROWS {
        let _infallible = writeln!(
            html,
            "<p class=\"note\">The first {MOST_ROWS} of {rows} rows; the files have all.</p>"
        );
    }
    html
}

/// A cell: rounded for reading, whole for sorting and under the pointer.
fn cell(column: &Column, row: usize) -> String {
    match &column.values {
        Values::Floats(values) if values[row].is_nan() => {
            "<td class=\"number\" data-value=\"\">–</td>".to_owned()
        }
        Values::Floats(values) => number(&values[row].to_string(), &rounded(values[row])),
        Values::Integers(values) => number(&values[row].to_string(), &values[row].to_string()),
        Values::Texts(values) => format!("<td>{}</td>", escaped(&values[row])),
        Values::Flags(values) => format!("<td>{}</td>", if values[row] { "yes" } else { "no" }),
    }
}

fn number(whole: &str, shown: &str) -> String {
    if whole == shown {
        format!("<td class=\"number\" data-value=\"{whole}\">{whole}</td>")
    } else {
        format!("<td class=\"number\" data-value=\"{whole}\" title=\"{whole}\">{shown}</td>")
    }
}

/// Four significant digits, or all digits of a whole number.
fn rounded(value: f64) -> String {
    if value.fract() == 0.0 && value.abs() < 1e15 {
        return format!("{value:.0}");
    }
    let magnitude = value.abs().log10().floor();
    if (-4.0..6.0).contains(&magnitude) {
        format!("{value:.*}", (3.0 - magnitude).clamp(0.0, 8.0) as usize)
    } else {
        format!("{value:.3e}")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits_and_the_whole_one_is_kept() {
        let found = [0.0, 12.0, 0.5, 1.0 / 3.0, -1234.567, 123_456.7, 1e-9, 1e20].map(rounded);
        let want = ["0", "12", "0.5000", "0.3333", "-1235", "123457", "1.000e-9", "1.000e20"];
        assert_eq!(found, want);
        let column = Column::new("x", "s", vec![1.0 / 3.0, f64::NAN]);
        assert!(cell(&column, 0).contains("data-value=\"0.3333333333333333\""));
        assert!(cell(&column, 1).contains("data-value=\"\""));
    }

    #[test]
    fn names_and_cells_cannot_become_markup_and_long_tables_end() {
        let texts = vec!["<script>alert(1)</script>".to_owned(); MOST_ROWS + 1];
        let table = Table::new(vec![Column::new("<b>", "\"><i>", texts)]).unwrap();
        let html = html(&table);
        assert!(!html.contains("<script") && !html.contains("<b>") && !html.contains("<i>"));
        assert_eq!(html.matches("<td>").count(), MOST_ROWS);
        assert!(html.contains("The first 500 of 501 rows"));
    }
}

//! The page itself.

use std::fmt::Write;

use serde_json::Value;

use crate::figure::{Theme, colour_rules};

use super::{Report, Section, tables};

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The whole page.
pub(super) fn html(report: &Report) -> String {
    let colours = report.colours();
    let (light, dark) = (colour_rules(&colours, Theme::Light), colour_rules(&colours, Theme::Dark));
    let names: Vec<&str> =
        report.sections.iter().map(|s| s.run.manifest.command.as_str()).collect();
    let program = report.sections.first().map_or("", |s| s.run.manifest.program.as_str());
    let mut html = format!(
        "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'; \
         script-src 'unsafe-inline'\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n<title>{}</title>\n<style>\n{STYLE}\
         :root{{{light}}}\n@media (prefers-color-scheme: dark){{:root{{{dark}}}}}\n</style>\n</head>\n<body>\n\
         <header><h1>{}</h1><p>{}</p></header>\n",
        escaped(&names.join(", ")),
        escaped(&names.join(", ")),
        escaped(program),
    );
    if report.sections.len() > 1 {
        html += "<nav><ol>\n";
        for (place, section) in report.sections.iter().enumerate() {
            let (number, name) = (place + 1, escaped(&section.name()));
            let _infallible = writeln!(html, "<li><a href=\"#run{number}\">{name}</a></li>");
        }
        html += "</ol></nav>\n";
    }
    html += "<main>\n";
    for (place, section) in report.sections.iter().enumerate() {
        html += &section.html(place + 1);
    }
    let _infallible = write!(html, "</main>\n<script>\n{SCRIPT}</script>\n</body>\n</html>\n");
    html
}

impl Section {
    fn name(&self) -> String {
        let folder = self.run.folder.file_name();
        folder
            .map_or_else(|| self.run.manifest.command.clone(), |n| n.to_string_lossy().into_owned())
    }

    fn html(&self, number: usize) -> String {
        let manifest = &self.run.manifest;
        let mut html =
            format!("<section id=\"run{number}\">\n<h2>{}</h2>\n", escaped(&self.name()));
        if let Some(line) = manifest.machine["command_line"].as_str() {
            let _infallible = writeln!(
                html,
                "<p>Made by</p>\n<pre class=\"command\"><code>{}</code></pre>",
                escaped(line)
            );
        }
        for figure in &self.figures {
            let _infallible = writeln!(
                html,
                "<figure>{}<figcaption>{}</figcaption></figure>",
                figure.drawing.markup,
                escaped(&figure.name)
            );
        }
        for table in &self.tables {
            let _infallible = writeln!(
                html,
                "<details{}><summary>{} <small>{} rows</small></summary>\n{}</details>",
                if table.table.row_count() <= 40 { " open" } else { "" },
                escaped(&table.name),
                table.table.row_count(),
                tables::html(&table.table)
            );
        }
        if !self.left_out.is_empty() {
            html += "<p class=\"note\">Not shown:</p>\n<ul class=\"note\">\n";
            for (name, why) in &self.left_out {
                let _infallible = writeln!(html, "<li><code>{}</code>: {why}</li>", escaped(name));
            }
            html += "</ul>\n";
        }
        let _infallible = write!(
            html,
            "<details class=\"manifest\"><summary>Manifest</summary>\n<dl>\n<dt>key</dt><dd><code>{}</code></dd>\n</dl>\n",
            escaped(&manifest.key)
        );
        for (name, value) in [
            ("What decides the result", &manifest.plan),
            ("What was left out", &manifest.left_out),
            ("Where and how it ran", &manifest.machine),
        ] {
            html += &document(name, value);
        }
        html += "<h4>Files</h4>\n<div class=\"scroll\"><table><thead><tr><th scope=\"col\">file</th>\
                 <th scope=\"col\">SHA-256</th></tr></thead><tbody>\n";
        for file in &manifest.files {
            let _infallible = writeln!(
                html,
                "<tr><td>{}</td><td><code>{}</code></td></tr>",
                escaped(&file.name),
                escaped(&file.sha256)
            );
        }
        html + "</tbody></table></div>\n</details>\n</section>\n"
    }
}

/// A JSON document under its heading; nothing for an empty one.
fn document(name: &str, value: &Value) -> String {
    let is_empty = match value {
        Value::Array(list) => list.is_empty(),
        Value::Object(map) => map.is_empty(),
        other => other.is_null(),
    };
    if is_empty {
        return String::new();
    }
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    format!("<h4>{name}</h4>\n<pre><code>{}</code></pre>\n", escaped(&text))
}

/// Text as HTML wants it, in elements and in quoted attributes.
pub(super) fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => escaped += "&amp;",
            '<' => escaped += "&lt;",
            '>' => escaped += "&gt;",
            '"' => escaped += "&quot;",
            '\'' => escaped += "&#39;",
            '\n' => escaped.push('\n'),
            other if other.is_control() => {}
            other => escaped.push(other),
        }
    }
    escaped
}

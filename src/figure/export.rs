//! From SVG text to the three files of a figure: `.svg` to edit, `.pdf` to print, `.png` to look at.
//!
//! Nothing in them depends on the clock, the machine's fonts or its threads.

use std::path::{Path, PathBuf};

use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg::Tree;
use svg2pdf::{ConversionOptions, PageOptions};

use super::{FigureError, fonts, pdf};
use crate::files;

/// Resolution of pictures, pixels per inch.
pub const PNG_DPI: f64 = 300.0;

/// Largest side of a picture, pixels.
const LARGEST_SIDE: f64 = 20_000.0;

/// Writes `<stem>.svg`, `<stem>.pdf` and `<stem>.png`, and says where.
pub fn write_figure(stem: &Path, svg: &str) -> Result<[PathBuf; 3], FigureError> {
    let target = |extension: &str| {
        let mut name = stem.file_name().unwrap_or_default().to_os_string();
        name.push(extension);
        stem.with_file_name(name)
    };
    let paths = [target(".svg"), target(".pdf"), target(".png")];
    let [svg_path, pdf_path, png_path] = &paths;
    let pdf = pdf_from_svg(svg)?;
    let png = png_from_svg(svg, PNG_DPI)?;
    files::write_atomic(svg_path, svg.as_bytes())?;
    files::write_atomic(pdf_path, &pdf)?;
    files::write_atomic(png_path, &png)?;
    Ok(paths)
}

/// A one-page PDF of the figure's size, with text as text.
pub fn pdf_from_svg(svg: &str) -> Result<Vec<u8>, FigureError> {
    let fail = |what: String| FigureError::Conversion { format: "PDF", what };
    let page = PageOptions { dpi: 72.0 };
    let pdf = svg2pdf::to_pdf(&parsed(svg)?, ConversionOptions::default(), page)
        .map_err(|error| fail(error.to_string()))?;
    pdf::in_fixed_order(&pdf)
        .ok_or_else(|| fail("its structure is not the expected one".to_owned()))
}

/// A picture on white paper.
pub fn png_from_svg(svg: &str, dpi: f64) -> Result<Vec<u8>, FigureError> {
    let tree = parsed(svg)?;
    let scale = dpi / 72.0;
    let width = (f64::from(tree.size().width()) * scale).round();
    let height = (f64::from(tree.size().height()) * scale).round();
    let size = || FigureError::PictureSize { width, height };
    if !(1.0..=LARGEST_SIDE).contains(&width) || !(1.0..=LARGEST_SIDE).contains(&height) {
        return Err(size());
    }
    let mut picture = Pixmap::new(width as u32, height as u32).ok_or_else(size)?;
    picture.fill(Color::WHITE);
    let transform = Transform::from_scale(scale as f32, scale as f32);
    resvg::render(&tree, transform, &mut picture.as_mut());
    picture
        .encode_png()
        .map_err(|error| FigureError::Conversion { format: "PNG", what: error.to_string() })
}

fn parsed(svg: &str) -> Result<Tree, FigureError> {
    Tree::from_str(svg, &fonts::options())
        .map_err(|error| FigureError::InvalidSvg { what: error.to_string() })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_svg_is_refused() {
        assert!(matches!(pdf_from_svg("<svg"), Err(FigureError::InvalidSvg { .. })));
        let flat = r#"<svg xmlns="http://www.w3.org/2000/svg" width="90000" height="1"/>"#;
        assert!(matches!(png_from_svg(flat, PNG_DPI), Err(FigureError::PictureSize { .. })));
    }
}

//! One request to a server for a file, or for the rest of a file. The only place that opens a connection.

use std::io::{Read, Write};
use std::net::IpAddr;
use std::path::Path;

use ureq::http::{StatusCode, Uri, header};
use ureq::{Agent, Error};

use super::fetch::Patience;
use super::{DataEvent, RemoteFile};
use crate::files::{self, FileError};

const MOST_REDIRECTS: u32 = 5;
const PIECE: usize = 1 << 16;

/// Why a request did not bring the whole file.
pub(super) enum Failure {
    /// Another try may help.
    Passing(String),
    /// No try will help.
    Final(String),
    /// The file cannot be written here.
    Disk(FileError),
}

/// A server and how it is spoken to.
pub(super) struct Server<'a> {
    agent: Agent,
    address: &'a str,
}

impl<'a> Server<'a> {
    /// The server of `address`; `only_https` refuses to be sent elsewhere without encryption.
    pub(super) fn new(address: &'a str, only_https: bool, patience: Patience) -> Self {
        let mut config = Agent::config_builder()
            .https_only(only_https)
            .http_status_as_error(false)
            .max_redirects(MOST_REDIRECTS)
            .max_redirects_will_error(true)
            .accept_encoding("identity")
            .user_agent(concat!("arnold-analyze/", env!("CARGO_PKG_VERSION")))
            .timeout_resolve(Some(patience.connect))
            .timeout_connect(Some(patience.connect))
            .timeout_recv_response(Some(patience.silence))
            .timeout_per_read(Some(patience.silence));
        if is_this_machine(address) {
            config = config.proxy(None);
        }
        Self { agent: config.build().into(), address }
    }

    /// Fetches `file` from byte `start` on and appends to `part` what comes.
    pub(super) fn fetch(
        &self,
        file: &RemoteFile<'_>,
        part: &Path,
        start: u64,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), Failure> {
        let mut request = self.agent.get(self.address);
        if start > 0 {
            request = request.header(header::RANGE, format!("bytes={start}-"));
        }
        let response = request.call().map_err(|error| failure(&error))?;
        let header = |name| response.headers().get(name).and_then(|value| value.to_str().ok());
        let (start, total) = match response.status() {
            StatusCode::OK => {
                // The server may know no ranges and begin again.
                let length = header(header::CONTENT_LENGTH).and_then(|text| text.parse().ok());
                (0, length)
            }
            StatusCode::PARTIAL_CONTENT => {
                match header(header::CONTENT_RANGE).and_then(content_range) {
                    Some((first, total)) if first == start => (start, total),
                    _ => {
                        files::remove(part).map_err(Failure::Disk)?;
                        return Err(Failure::Passing("another range than asked for".to_owned()));
                    }
                }
            }
            StatusCode::RANGE_NOT_SATISFIABLE if start > 0 => {
                files::remove(part).map_err(Failure::Disk)?;
                return Err(Failure::Passing("the rest is not there".to_owned()));
            }
            status => {
                let reason = format!("the server answered {status}");
                let is_passing = status.is_server_error()
                    || matches!(
                        status,
                        StatusCode::REQUEST_TIMEOUT | StatusCode::TOO_MANY_REQUESTS
                    );
                return Err(if is_passing { Failure::Passing } else { Failure::Final }(reason));
            }
        };
        if let Some(total) = total.filter(|&total| total != file.bytes) {
            let reason = format!("the file there has {total} bytes, expected {}", file.bytes);
            return Err(Failure::Final(reason));
        }
        if start == 0 {
            files::remove(part).map_err(Failure::Disk)?;
        }
        observe(DataEvent::Fetching {
            file: file.name.to_owned(),
            address: self.address.to_owned(),
            start,
            bytes: file.bytes,
        });
        append(response.into_body().into_reader(), part, file.bytes - start, observe)
    }
}

/// Appends exactly `expected` bytes of `reader` to `part`.
fn append(
    mut reader: impl Read,
    part: &Path,
    expected: u64,
    observe: &mut dyn FnMut(DataEvent),
) -> Result<(), Failure> {
    let mut file = files::open_to_append(part).map_err(Failure::Disk)?;
    let disk = |source| Failure::Disk(FileError::Write { path: part.to_path_buf(), source });
    let mut buffer = vec![0; PIECE];
    let mut left = expected;
    loop {
        let count = reader.read(&mut buffer).map_err(|error| failure(&Error::from(error)))?;
        if count == 0 {
            break;
        }
        left = left
            .checked_sub(count as u64)
            .ok_or_else(|| Failure::Final("the server sends more than the file".to_owned()))?;
        file.write_all(&buffer[..count]).map_err(disk)?;
        observe(DataEvent::Received(count as u64));
    }
    file.sync_all().map_err(disk)?;
    if left > 0 {
        return Err(Failure::Passing(format!("the connection ended {left} bytes too early")));
    }
    Ok(())
}

/// First byte and total of `bytes first-last/total`; the total may be unknown, `*`.
fn content_range(text: &str) -> Option<(u64, Option<u64>)> {
    let (range, total) = text.strip_prefix("bytes ")?.split_once('/')?;
    let (first, _last) = range.split_once('-')?;
    let total = if total == "*" { None } else { Some(total.parse().ok()?) };
    Some((first.parse().ok()?, total))
}

/// Whether trying again may help depends on what went wrong.
fn failure(error: &Error) -> Failure {
    let reason = error.to_string();
    match error {
        Error::Io(_)
        | Error::Timeout(_)
        | Error::HostNotFound
        | Error::ConnectionFailed
        | Error::Protocol(_)
        | Error::ConnectProxyFailed(_) => Failure::Passing(reason),
        _ => Failure::Final(reason),
    }
}

/// Whether `address` names this machine, which no proxy can reach for us.
fn is_this_machine(address: &str) -> bool {
    let Ok(address) = address.parse::<Uri>() else { return false };
    let host = address.host().unwrap_or_default().trim_matches(['[', ']']);
    host == "localhost" || host.parse::<IpAddr>().is_ok_and(|number| number.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_range_is_read_only_when_it_says_where_it_starts() {
        assert_eq!(content_range("bytes 5-9/10"), Some((5, Some(10))));
        assert_eq!(content_range("bytes 5-9/*"), Some((5, None)));
        for wrong in ["", "bytes", "bytes */10", "bytes 5-9", "bytes x-9/10", "items 5-9/10"] {
            assert_eq!(content_range(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn this_machine_is_known_by_its_names() {
        assert!(is_this_machine("http://127.0.0.1:8080/a"));
        assert!(is_this_machine("http://localhost/a"));
        assert!(is_this_machine("http://[::1]:80/a"));
        assert!(!is_this_machine("https://example.org/127.0.0.1"));
        assert!(!is_this_machine("https://localhost.example.org/"));
    }
}

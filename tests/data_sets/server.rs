//! A server for one file that can be told to answer wrongly.

use std::io::{BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use arnold_analyze::assets::data::Origin;

/// How one request is answered.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Answer {
    /// The file, or the range asked for.
    Whole,
    /// That many bytes of what was asked for, then the connection ends.
    Cut(usize),
    /// That many bytes, then nothing, with the connection open.
    Stall(usize),
    /// The whole file, whatever was asked for.
    WithoutRange,
    /// A range from another byte on.
    RangeFrom(usize),
    /// A status line and no file.
    Status(&'static str),
    /// Another address.
    Redirect(&'static str),
    /// More and more bytes without saying how many.
    Endless,
    /// No answer.
    Silence,
}

/// Listens until it is dropped.
pub(crate) struct Server {
    address: SocketAddr,
    requests: Arc<Mutex<Vec<String>>>,
    stopped: Arc<AtomicBool>,
    thread: Option<std::thread::JoinHandle<()>>,
}

impl Server {
    /// Serves `content`; `answer` decides by the number of the request.
    pub(crate) fn start(content: &[u8], answer: fn(usize) -> Answer) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = listener.local_addr().unwrap();
        let requests = Arc::new(Mutex::new(Vec::new()));
        let stopped = Arc::new(AtomicBool::new(false));
        let (content, log, stop) = (content.to_vec(), requests.clone(), stopped.clone());
        let thread = std::thread::spawn(move || {
            for stream in listener.incoming() {
                if stop.load(Ordering::SeqCst) {
                    break;
                }
                // A client that was killed is no fault of the server.
                let _client_gone = serve(stream.unwrap(), &content, answer, &log);
            }
        });
        Self { address, requests, stopped, thread: Some(thread) }
    }

    pub(crate) fn base(&self) -> String {
        format!("http://{}/base", self.address)
    }

    pub(crate) fn origin(&self) -> Origin {
        Origin::Server(self.base() + "/")
    }

    /// Path and range of every request so far.
    pub(crate) fn requests(&self) -> Vec<String> {
        self.requests.lock().unwrap().clone()
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.stopped.store(true, Ordering::SeqCst);
        let _wake_it = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
    }
}

fn serve(
    mut stream: TcpStream,
    content: &[u8],
    answer: fn(usize) -> Answer,
    log: &Mutex<Vec<String>>,
) -> std::io::Result<()> {
    stream.set_read_timeout(Some(Duration::from_secs(5)))?;
    let mut lines = BufReader::new(stream.try_clone()?).lines();
    let first = lines.next().unwrap_or(Ok(String::new()))?;
    let path = first.split(' ').nth(1).unwrap_or_default().to_owned();
    let mut range = String::new();
    for line in lines {
        let line = line?;
        if line.is_empty() {
            break;
        }
        if let Some((name, value)) = line.split_once(':')
            && name.eq_ignore_ascii_case("range")
        {
            value.trim().clone_into(&mut range);
        }
    }
    let number = {
        let mut log = log.lock().unwrap();
        log.push(format!("{path} {range}"));
        log.len() - 1
    };
    let asked = range.strip_prefix("bytes=").and_then(|text| text.strip_suffix('-'));
    let start = asked.and_then(|text| text.parse::<usize>().ok());
    let answer = answer(number);
    let start = match answer {
        Answer::RangeFrom(other) => Some(other),
        Answer::WithoutRange => None,
        _ => start,
    };
    let total = content.len();
    let (status, rest) = match start {
        Some(start) if start >= total => {
            ("416 Range Not Satisfiable".to_owned(), &content[total..])
        }
        Some(start) => {
            let range = format!(
                "206 Partial Content\r\nContent-Range: bytes {start}-{}/{total}",
                total - 1
            );
            (range, &content[start..])
        }
        None => ("200 OK".to_owned(), content),
    };
    let length =
        format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\nConnection: close\r\n\r\n", rest.len());
    match answer {
        Answer::Whole | Answer::WithoutRange | Answer::RangeFrom(_) => {
            stream.write_all(length.as_bytes())?;
            stream.write_all(rest)
        }
        Answer::Cut(bytes) => {
            stream.write_all(length.as_bytes())?;
            stream.write_all(&rest[..bytes])
        }
        Answer::Stall(bytes) => {
            stream.write_all(length.as_bytes())?;
            stream.write_all(&rest[..bytes])?;
            // Until the client goes away.
            let mut lines = BufReader::new(stream).lines();
            let _nothing_comes = lines.next();
            Ok(())
        }
        Answer::Status(status) => {
            let text =
                format!("HTTP/1.1 {status}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
            stream.write_all(text.as_bytes())
        }
        Answer::Redirect(place) => {
            let text = format!(
                "HTTP/1.1 302 Found\r\nLocation: {place}\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"
            );
            stream.write_all(text.as_bytes())
        }
        Answer::Endless => {
            stream.write_all(b"HTTP/1.1 200 OK\r\nConnection: close\r\n\r\n")?;
            loop {
                stream.write_all(&[7; 4096])?;
            }
        }
        Answer::Silence => {
            std::thread::sleep(Duration::from_millis(500));
            Ok(())
        }
    }
}

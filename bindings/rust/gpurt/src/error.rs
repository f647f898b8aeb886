//! Results of the C ABI as errors.
use std::ffi::CStr;
use std::fmt;

use crate::sys;

/// What went wrong: one variant for each result code, with the library's text of cause and remedy.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum Error {
    /// An argument was not allowed.
    InvalidArgument(String),
    /// Memory ran out, or the device's limit was reached.
    OutOfMemory(String),
    /// This version, build or device cannot do it.
    Unsupported(String),
    /// The job was cancelled.
    Cancelled(String),
    /// There is no such device, its driver failed, or a fault ended the process' work on it.
    Device(String),
    /// The time to wait is over.
    Timeout(String),
    /// A file could not be read or written.
    Io(String),
    /// A defect of the library.
    Internal(String),
}

/// Shorthand for what fallible functions of this crate return.
pub type Result<T, E = Error> = std::result::Result<T, E>;

impl Error {
    /// The text of cause and remedy.
    pub fn message(&self) -> &str {
        match self {
            Error::InvalidArgument(text)
            | Error::OutOfMemory(text)
            | Error::Unsupported(text)
            | Error::Cancelled(text)
            | Error::Device(text)
            | Error::Timeout(text)
            | Error::Io(text)
            | Error::Internal(text) => text,
        }
    }
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.message())
    }
}

impl std::error::Error for Error {}

/// Turns the result of a call that this thread just made into an error with its text.
pub(crate) fn check(result: sys::gpurt_result) -> Result<()> {
    if result == sys::GPURT_OK {
        return Ok(());
    }
    // SAFETY: the text is valid until this thread calls gpurt again; it is copied here.
    let text = unsafe { CStr::from_ptr(sys::gpurt_last_error()) }.to_string_lossy().into_owned();
    Err(match result {
        sys::GPURT_ERROR_INVALID_ARGUMENT => Error::InvalidArgument(text),
        sys::GPURT_ERROR_OUT_OF_MEMORY => Error::OutOfMemory(text),
        sys::GPURT_ERROR_UNSUPPORTED => Error::Unsupported(text),
        sys::GPURT_ERROR_CANCELLED => Error::Cancelled(text),
        sys::GPURT_ERROR_DEVICE => Error::Device(text),
        sys::GPURT_ERROR_TIMEOUT => Error::Timeout(text),
        sys::GPURT_ERROR_IO => Error::Io(text),
        sys::GPURT_ERROR_INTERNAL => Error::Internal(text),
        code => Error::Internal(format!("result {} is newer than this crate: {}", code, text)),
    })
}

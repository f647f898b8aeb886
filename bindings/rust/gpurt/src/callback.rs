//! Closures that the library calls: log and progress functions.
//!
//! C gets a number instead of a pointer to the closure, and looks the closure up when it calls. A call that
//! comes after the closure is gone finds nothing, so no order of drops can reach freed memory.
#![allow(clippy::declare_interior_mutable_const)] // thread_local! makes one

use std::cell::Cell;
use std::ffi::{c_void, CStr};
use std::os::raw::c_char;
use std::panic::{catch_unwind, AssertUnwindSafe};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::error::{check, Error, Result};
use crate::{sys, LogLevel};

pub(crate) type LogFn = Arc<dyn Fn(LogLevel, &str) + Send + Sync>;
pub(crate) type ProgressFn = Arc<dyn Fn(f64, f64) + Send + Sync>;

#[derive(Clone)]
pub(crate) enum Closure {
    Log(LogFn),
    Progress(ProgressFn),
}

struct Entry {
    closure: Closure,
    panicked: AtomicBool,
}

/// By ascending number.
static CLOSURES: Mutex<Vec<(usize, Arc<Entry>)>> = Mutex::new(Vec::new());

fn closures() -> MutexGuard<'static, Vec<(usize, Arc<Entry>)>> {
    // No user code runs under the lock, so a poisoned list is still sound.
    CLOSURES.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A closure that C can call by its number until this is dropped.
pub(crate) struct Registration(usize);

impl Registration {
    pub(crate) fn new(closure: Closure) -> Arc<Registration> {
        static NEXT: AtomicUsize = AtomicUsize::new(1);
        let entry = Arc::new(Entry { closure, panicked: AtomicBool::new(false) });
        let mut closures = closures();
        let number = NEXT.fetch_add(1, Ordering::Relaxed); // under the lock: the list stays sorted
        closures.push((number, entry));
        Arc::new(Registration(number))
    }

    /// What the library hands back to the functions below; never dereferenced.
    pub(crate) fn user(&self) -> *mut c_void {
        self.0 as *mut c_void
    }
}

/// What an object has from its device: the closures that the library may call while a handle is held, and which device
/// it is. Children hold their parents' too.
#[derive(Clone, Default)]
pub(crate) struct Callbacks {
    closures: Vec<Arc<Registration>>,
    device: usize, // the value of its handle, which names no other device as long as this one is held
}

impl Callbacks {
    pub(crate) fn push(&mut self, closure: Arc<Registration>) {
        self.closures.push(closure);
    }

    pub(crate) fn set_device(&mut self, device: crate::sys::gpurt_device) {
        self.device = device as usize;
    }

    /// Whether both belong to one device.
    pub(crate) fn share_device(&self, other: &Callbacks) -> bool {
        self.device == other.device
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        let mut closures = closures();
        let entry = closures.binary_search_by_key(&self.0, |(number, _)| *number).map(|i| closures.remove(i));
        drop(closures);
        drop(entry); // without the lock: what the closure captured may drop gpurt objects
    }
}

thread_local! {
    /// Whether this thread is in a closure that the library called.
    static IN_CALLBACK: Cell<bool> = const { Cell::new(false) };
}

/// Runs a registered closure. Its panic ends here, for unwinding must not enter C; the panic hook has
/// reported it. After a panic the closure is not called again.
fn run(user: *mut c_void, f: impl FnOnce(&Closure)) {
    let entry = {
        let closures = closures();
        match closures.binary_search_by_key(&(user as usize), |(number, _)| *number) {
            Ok(i) => closures[i].1.clone(),
            Err(_) => return,
        }
    };
    if entry.panicked.load(Ordering::Relaxed) {
        return;
    }
    let before = IN_CALLBACK.with(|flag| flag.replace(true));
    let outcome = catch_unwind(AssertUnwindSafe(|| f(&entry.closure)));
    entry.panicked.fetch_or(outcome.is_err(), Ordering::Relaxed);
    // This may run destructors of the program's, which may panic too.
    if let Err(payload) = catch_unwind(AssertUnwindSafe(move || drop((outcome, entry)))) {
        std::mem::forget(payload);
    }
    IN_CALLBACK.with(|flag| flag.set(before));
}

pub(crate) unsafe extern "C" fn log(user: *mut c_void, level: sys::gpurt_log_level, message: *const c_char) {
    // SAFETY: the library passes a terminated string that is valid during the call.
    let message = unsafe { CStr::from_ptr(message) }.to_string_lossy();
    // A level that this crate does not know is at least as chatty as the last that it knows.
    let level = LogLevel::from_raw(level).unwrap_or(LogLevel::Info);
    run(user, |closure| {
        if let Closure::Log(f) = closure {
            f(level, &message)
        }
    });
}

pub(crate) unsafe extern "C" fn progress(user: *mut c_void, done: f64, total: f64) {
    run(user, |closure| {
        if let Closure::Progress(f) = closure {
            f(done, total)
        }
    });
}

/// Calls the library, unless this thread is in one of its callbacks: there it would wait for itself.
pub(crate) fn call(f: impl FnOnce() -> sys::gpurt_result) -> Result<()> {
    if IN_CALLBACK.with(Cell::get) {
        return Err(Error::InvalidArgument(
            "a log or progress function called gpurt, which waits for that function; pass what it needs to \
             another thread instead"
                .into(),
        ));
    }
    check(f())
}

/// Gives a handle back: at once, or from another thread where this one is in a callback.
pub(crate) fn release<T: 'static>(raw: *mut T, f: unsafe extern "C" fn(*mut T) -> sys::gpurt_result) {
    let address = raw as usize;
    // SAFETY: the owner of the handle calls this once, when it is dropped.
    let release = move || unsafe { f(address as *mut T) };
    if IN_CALLBACK.with(Cell::get) {
        // Without a thread to be had the object leaks, which is better than waiting for ever.
        let _ = std::thread::Builder::new().spawn(release);
    } else {
        release();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;
    use std::time::Duration;

    fn register_progress(f: impl Fn(f64, f64) + Send + Sync + 'static) -> Arc<Registration> {
        Registration::new(Closure::Progress(Arc::new(f)))
    }

    /// Does what the library does.
    fn call_progress(user: *mut c_void, done: f64) {
        // SAFETY: takes any number.
        unsafe { progress(user, done, 8.0) }
    }

    #[test]
    fn closures_are_called_until_they_are_gone() {
        let (sender, calls) = mpsc::channel();
        let sender = Mutex::new(sender);
        let registration =
            register_progress(move |done, total| sender.lock().unwrap().send((done, total)).unwrap());
        let user = registration.user();
        let other = register_progress(|_, _| panic!("not the one that was called"));
        call_progress(user, 1.0);
        let again = registration.clone();
        drop(registration);
        call_progress(user, 2.0);
        drop(again);
        call_progress(user, 3.0); // nothing to call any more
        drop(other);
        assert_eq!(calls.iter().collect::<Vec<_>>(), [(1.0, 8.0), (2.0, 8.0)]);
    }

    #[test]
    fn log_passes_level_and_text() {
        let messages = Arc::new(Mutex::new(Vec::new()));
        let sink = messages.clone();
        let registration = Registration::new(Closure::Log(Arc::new(move |level, text: &str| {
            sink.lock().unwrap().push((level, text.to_string()));
        })));
        let text = std::ffi::CString::new("caf\u{e9}").unwrap();
        // SAFETY: a terminated string.
        unsafe { log(registration.user(), sys::GPURT_LOG_WARNING, text.as_ptr()) };
        unsafe { log(registration.user(), 99, text.as_ptr()) };
        let messages = messages.lock().unwrap();
        assert_eq!(messages[..], [(LogLevel::Warning, "café".into()), (LogLevel::Info, "café".into())]);
    }

    #[test]
    fn a_panic_ends_at_the_boundary() {
        struct PanicsWhenDropped;
        impl Drop for PanicsWhenDropped {
            fn drop(&mut self) {
                std::panic::panic_any("expected by the test: destructor of a panic's payload");
            }
        }
        let calls = Arc::new(AtomicUsize::new(0));
        let counter = calls.clone();
        let registration = register_progress(move |_, _| {
            counter.fetch_add(1, Ordering::Relaxed);
            std::panic::panic_any(PanicsWhenDropped);
        });
        call_progress(registration.user(), 1.0);
        call_progress(registration.user(), 2.0);
        assert_eq!(calls.load(Ordering::Relaxed), 1, "called again after a panic");
        assert!(call(|| sys::GPURT_OK).is_ok(), "this thread still counts as in a callback");
    }

    #[test]
    fn the_library_cannot_be_called_from_a_callback() {
        let (sender, results) = mpsc::channel();
        let sender = Mutex::new(sender);
        let registration = register_progress(move |_, _| {
            sender.lock().unwrap().send(call(|| unreachable!("the library was called"))).unwrap()
        });
        call_progress(registration.user(), 1.0);
        let error = results.recv().unwrap().unwrap_err();
        assert!(
            matches!(&error, Error::InvalidArgument(text) if text.contains("progress function")),
            "{}",
            error
        );
        assert!(call(|| sys::GPURT_OK).is_ok());
    }

    #[test]
    fn handles_dropped_in_a_callback_are_released_by_another_thread() {
        static RELEASED_BY: Mutex<Option<std::thread::ThreadId>> = Mutex::new(None);
        unsafe extern "C" fn note(_: *mut u8) -> sys::gpurt_result {
            *RELEASED_BY.lock().unwrap() = Some(std::thread::current().id());
            sys::GPURT_OK
        }
        let registration = register_progress(|_, _| release(1 as *mut u8, note));
        call_progress(registration.user(), 1.0);
        for _ in 0..1000 {
            if RELEASED_BY.lock().unwrap().is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let thread = RELEASED_BY.lock().unwrap().expect("released within ten seconds");
        assert_ne!(thread, std::thread::current().id());
    }
}

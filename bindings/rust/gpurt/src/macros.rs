//! What the types of this crate have in common.

/// An owner of a handle, with `Clone` and `Drop`.
macro_rules! handle {
    ($(#[$doc:meta])* $name:ident: $raw:ident, $retain:ident, $release:ident) => {
        $(#[$doc])*
        pub struct $name {
            raw: crate::sys::$raw,
            callbacks: crate::callback::Callbacks,
        }

        impl $name {
            /// The handle, for calls of [`sys`](crate::sys). This object keeps its reference.
            pub fn as_raw(&self) -> crate::sys::$raw {
                self.raw
            }

            /// Takes over the reference that a creating function gave, and the closures that the library may
            /// call while it is held.
            fn own(raw: crate::sys::$raw, callbacks: crate::callback::Callbacks) -> Self {
                $name { raw, callbacks }
            }
        }

        impl Clone for $name {
            /// Makes another owner of the same object.
            fn clone(&self) -> Self {
                // SAFETY: the handle is valid while self lives. Retaining such a handle cannot fail.
                let result = unsafe { crate::sys::$retain(self.raw) };
                assert_eq!(result, crate::sys::GPURT_OK, "retaining a valid handle failed");
                $name { raw: self.raw, callbacks: self.callbacks.clone() }
            }
        }

        impl Drop for $name {
            fn drop(&mut self) {
                crate::callback::release(self.raw, crate::sys::$release);
            }
        }

        impl std::fmt::Debug for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, concat!(stringify!($name), "({:p})"), self.raw)
            }
        }

        // SAFETY: handles belong to no thread: the ABI lets any function be called, and the last reference be
        // released, from any thread. The closures are Send and Sync.
        unsafe impl Send for $name {}
        // SAFETY: the library guards its objects: calls through one handle may be made from several threads
        // at once, and calls that change one scene exclude each other.
        unsafe impl Sync for $name {}
    };
}

/// An enum with the values of an enum of the ABI.
macro_rules! c_enum {
    ($(#[$doc:meta])* $name:ident { $($(#[$variant_doc:meta])* $variant:ident = $value:ident,)* }) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        #[non_exhaustive]
        #[repr(u32)]
        pub enum $name { $($(#[$variant_doc])* $variant = crate::sys::$value,)* }

        impl $name {
            #[allow(dead_code)] // of enums that the library never hands out
            pub(crate) fn from_raw(raw: u32) -> crate::Result<Self> {
                match raw {
                    $(crate::sys::$value => Ok($name::$variant),)*
                    _ => Err(crate::Error::Internal(format!(
                        "the library answers with a {} {} that is newer than this crate",
                        stringify!($name),
                        raw
                    ))),
                }
            }
        }
    };
}

/// A struct that is read from a struct of the ABI: fields that are the same there, then fields that are
/// converted.
macro_rules! filled_struct {
    ($(#[$doc:meta])* $name:ident: $raw_type:ident as $raw:ident {
        same { $($(#[$same_doc:meta])* $same:ident: $same_type:ty,)* }
        converted { $($(#[$field_doc:meta])* $field:ident: $type:ty = $value:expr,)* }
    }) => {
        $(#[$doc])*
        #[allow(clippy::derive_partial_eq_without_eq)] // those with floats cannot have it
        #[derive(Debug, Clone, PartialEq)]
        #[non_exhaustive]
        pub struct $name {
            $($(#[$same_doc])* pub $same: $same_type,)*
            $($(#[$field_doc])* pub $field: $type,)*
        }

        impl $name {
            pub(crate) fn from_raw($raw: &crate::sys::$raw_type) -> crate::Result<Self> {
                Ok($name { $($same: $raw.$same,)* $($field: $value,)* })
            }
        }
    };
}

/// A string of a struct of the ABI.
pub(crate) fn text(chars: &[std::os::raw::c_char]) -> String {
    let bytes: Vec<u8> = chars.iter().map(|&c| c as u8).take_while(|&byte| byte != 0).collect();
    String::from_utf8_lossy(&bytes).into_owned()
}

/// A path as the library takes it.
pub(crate) fn c_path(path: &std::path::Path) -> crate::Result<std::ffi::CString> {
    #[cfg(unix)]
    let bytes = std::os::unix::ffi::OsStrExt::as_bytes(path.as_os_str()).to_vec();
    #[cfg(not(unix))]
    let bytes = path.to_string_lossy().into_owned().into_bytes();
    std::ffi::CString::new(bytes)
        .map_err(|_| crate::Error::InvalidArgument(format!("{:?}: a path cannot have a zero byte", path)))
}

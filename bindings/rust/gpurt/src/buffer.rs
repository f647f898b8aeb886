//! Arrays for the library to read: slices, which it copies, and buffers, which it shares.
use std::ffi::c_void;
use std::fmt;
use std::marker::PhantomData;
use std::mem::size_of_val;
use std::ptr;

use crate::callback::call;
use crate::{sys, Device, DeviceBuffer, Pod, Result};

mod sealed {
    pub trait Sealed {}
}

/// What arrays consist of: `f32`, `u32`, and small arrays of them.
pub trait Element: sealed::Sealed + Copy + Send + Sync + 'static {}

macro_rules! elements {
    ($($type:ty)*) => {$(
        impl sealed::Sealed for $type {}
        impl Element for $type {}
    )*};
}
elements! { f32 [f32; 2] [f32; 3] u32 [u32; 3] }

handle! {
    /// An owner of a buffer handle.
    Shared: gpurt_buffer, gpurt_buffer_retain, gpurt_buffer_release
}

/// Memory of this program that scenes of a device read without a copy.
///
/// The elements live until the buffer and everything that uses it is gone.
///
/// ```
/// # fn main() -> gpurt::Result<()> {
/// use gpurt::{Buffer, Device, Mesh, Scene};
///
/// let device = Device::cpu()?;
/// let vertices = Buffer::new(&device, vec![[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])?;
/// let scene = Scene::new(&device)?;
/// scene.add_mesh(&Mesh::new(&vertices))?;
/// drop(vertices); // the scene still has it
/// # Ok(())
/// # }
/// ```
pub struct Buffer<T: Element> {
    shared: Shared,
    data: *const T,
    len: usize,
}

// SAFETY: the handle is Send and Sync (see the macro); `data` is only read, as through a shared slice.
unsafe impl<T: Element> Send for Buffer<T> {}
// SAFETY: as above.
unsafe impl<T: Element> Sync for Buffer<T> {}

impl<T: Element> Buffer<T> {
    /// Hands the elements to the device. They are not copied, and dropped once nothing reads them.
    pub fn new(device: &Device, elements: Vec<T>) -> Result<Self> {
        unsafe extern "C" fn drop_elements<T>(user: *mut c_void, _data: *mut c_void) {
            // SAFETY: `user` is the box below, given back once. Elements have no destructor that could panic.
            drop(unsafe { Box::from_raw(user as *mut Vec<T>) });
        }
        let (data, len) = (elements.as_ptr(), elements.len());
        let mut desc = sys::gpurt_buffer_desc {
            size_bytes: size_of_val(&elements[..]) as u64,
            data: data as *mut c_void, // the library only reads it
            release: Some(drop_elements::<T>),
            ..Default::default()
        };
        let user = Box::into_raw(Box::new(elements));
        desc.release_user = user as *mut c_void;
        let mut buffer = ptr::null_mut();
        // SAFETY: the memory stays where it is until the library calls `release`.
        let result = call(|| unsafe { sys::gpurt_buffer_create(device.as_raw(), &desc, &mut buffer) });
        if result.is_err() {
            // SAFETY: without a buffer the library does not call `release`; the box is still ours.
            drop(unsafe { Box::from_raw(user) });
        }
        result?;
        Ok(Buffer { shared: Shared::own(buffer, device.callbacks().clone()), data, len })
    }

    /// The elements.
    pub fn as_slice(&self) -> &[T] {
        // SAFETY: the vector lives unchanged until the last owner of the buffer has gone.
        unsafe { std::slice::from_raw_parts(self.data, self.len) }
    }

    /// The handle, for calls of [`sys`]. This object keeps its reference.
    pub fn as_raw(&self) -> sys::gpurt_buffer {
        self.shared.as_raw()
    }
}

impl<T: Element> Clone for Buffer<T> {
    /// Makes another owner of the same buffer.
    fn clone(&self) -> Self {
        Buffer { shared: self.shared.clone(), data: self.data, len: self.len }
    }
}

impl<T: Element> fmt::Debug for Buffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Buffer({:p}, {} elements)", self.as_raw(), self.len)
    }
}

/// Elements for the library to read: a slice or a [`DeviceBuffer`], which it copies during the call, or a
/// [`Buffer`], which it shares.
#[derive(Clone, Copy)]
pub struct Array<'a, T: Element> {
    pub(crate) raw: sys::gpurt_array,
    source: PhantomData<&'a T>,
}

// SAFETY: it stands for a shared slice, or a buffer, of elements that are Sync.
unsafe impl<T: Element> Send for Array<'_, T> {}
// SAFETY: as above.
unsafe impl<T: Element> Sync for Array<'_, T> {}

impl<'a, T: Element> From<&'a [T]> for Array<'a, T> {
    fn from(slice: &'a [T]) -> Self {
        let raw = sys::gpurt_array {
            data: slice.as_ptr() as *const c_void,
            count: slice.len() as u64,
            ..Default::default()
        };
        Array { raw, source: PhantomData }
    }
}

impl<'a, T: Element> From<&'a Vec<T>> for Array<'a, T> {
    fn from(vec: &'a Vec<T>) -> Self {
        vec.as_slice().into()
    }
}

impl<'a, T: Element, const N: usize> From<&'a [T; N]> for Array<'a, T> {
    fn from(array: &'a [T; N]) -> Self {
        array.as_slice().into()
    }
}

impl<'a, T: Element + Pod> From<&'a DeviceBuffer<T>> for Array<'a, T> {
    fn from(buffer: &'a DeviceBuffer<T>) -> Self {
        let raw =
            sys::gpurt_array { buffer: buffer.as_raw(), count: buffer.len() as u64, ..Default::default() };
        Array { raw, source: PhantomData }
    }
}

impl<'a, T: Element> From<&'a Buffer<T>> for Array<'a, T> {
    fn from(buffer: &'a Buffer<T>) -> Self {
        let raw =
            sys::gpurt_array { buffer: buffer.as_raw(), count: buffer.len as u64, ..Default::default() };
        Array { raw, source: PhantomData }
    }
}

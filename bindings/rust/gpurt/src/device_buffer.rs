//! Arrays in the memory of a device.
use std::ffi::c_void;
use std::fmt;
use std::marker::PhantomData;
use std::mem::size_of;
use std::ptr;

use crate::callback::{call, Callbacks};
use crate::{sys, Device, Error, Hit, HitCompact, Ray, Result};

/// Plain values: bytes that can be copied to a device and back.
///
/// # Safety
///
/// Every pattern of bytes, all zero among them, must be a value of the type, and it must have no padding.
pub unsafe trait Pod: Copy + Send + Sync + 'static {}

macro_rules! plain {
    ($($type:ty)*) => {$(
        // SAFETY: a number, or a struct of numbers without gaps between them.
        unsafe impl Pod for $type {}
    )*};
}
plain! { u8 i8 u16 i16 u32 i32 u64 i64 usize isize f32 f64 Ray Hit HitCompact }
// SAFETY: elements follow each other without gaps.
unsafe impl<T: Pod, const N: usize> Pod for [T; N] {}

const _: () = assert!(size_of::<Ray>() == 8 * 4 && size_of::<Hit>() == 8 * 4 && size_of::<HitCompact>() == 4 * 4);

handle! {
    /// An owner of a buffer handle.
    Owner: gpurt_buffer, gpurt_buffer_retain, gpurt_buffer_release
}

/// An array in the memory of a device: a GPU's own, or, of the CPU, host memory. Queries read rays there and leave hits
/// there; meshes can be made of it.
///
/// ```
/// # fn main() -> gpurt::Result<()> {
/// use gpurt::{Device, DeviceBuffer, Hit, Mesh, Ray, Scene, IDENTITY};
///
/// let device = Device::new()?; // a GPU, else the CPU
/// let scene = Scene::new(&device)?;
/// let vertices = DeviceBuffer::from_slice(&device, &[[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])?;
/// let triangle = scene.add_mesh(&Mesh::new(&vertices))?;
/// scene.add_instance(triangle, IDENTITY)?;
/// scene.commit()?;
///
/// let rays = DeviceBuffer::from_slice(&device, &[Ray::new([0.25, 0.25, 1.0], [0.0, 0.0, -1.0])])?;
/// let mut hits = DeviceBuffer::<Hit>::new(&device, rays.len())?;
/// scene.closest_on_device(&rays, &mut hits)?;
/// assert_eq!(hits.download()?[0].primitive, 0);
/// # Ok(())
/// # }
/// ```
pub struct DeviceBuffer<T: Pod> {
    owner: Owner,
    data: *mut T, // in device memory: never dereferenced here
    len: usize,
    elements: PhantomData<T>,
}

// SAFETY: the handle is Send and Sync (see the macro); `data` is an address alone, and whoever writes to the memory
// borrows the buffer mutably.
unsafe impl<T: Pod> Send for DeviceBuffer<T> {}
// SAFETY: as above.
unsafe impl<T: Pod> Sync for DeviceBuffer<T> {}

impl<T: Pod> DeviceBuffer<T> {
    /// An array of `len` elements whose bytes are zero.
    pub fn new(device: &Device, len: usize) -> Result<Self> {
        // The library has no empty buffers.
        let size = len.checked_mul(size_of::<T>()).map(|bytes| bytes.max(1) as u64);
        let size_bytes =
            size.ok_or_else(|| Error::OutOfMemory(format!("{} elements do not fit into memory", len)))?;
        let desc = sys::gpurt_buffer_desc {
            storage: sys::GPURT_STORAGE_DEVICE,
            size_bytes,
            ..Default::default()
        };
        Self::create(device, &desc, len)
    }

    /// An array with these elements.
    pub fn from_slice(device: &Device, elements: &[T]) -> Result<Self> {
        let mut buffer = Self::new(device, elements.len())?;
        buffer.upload(elements)?;
        Ok(buffer)
    }

    /// An array in device memory that something else has allocated, and keeps.
    ///
    /// # Safety
    ///
    /// `data` must be the address of `len` elements in the memory of the device, which stay valid, and which nothing else
    /// writes, for as long as the buffer, or a scene that was made with it, lives.
    pub unsafe fn from_device_ptr(device: &Device, data: *mut T, len: usize) -> Result<Self> {
        let desc = sys::gpurt_buffer_desc {
            storage: sys::GPURT_STORAGE_DEVICE,
            size_bytes: (len * size_of::<T>()) as u64,
            data: data as *mut c_void,
            ..Default::default()
        };
        Self::create(device, &desc, len)
    }

    fn create(device: &Device, desc: &sys::gpurt_buffer_desc, len: usize) -> Result<Self> {
        let mut raw = ptr::null_mut();
        // SAFETY: the handle is valid; the descriptor and the output live during the call.
        call(|| unsafe { sys::gpurt_buffer_create(device.as_raw(), desc, &mut raw) })?;
        let owner = Owner::own(raw, device.callbacks().clone());
        let (mut data, mut size) = (ptr::null_mut(), 0);
        // SAFETY: the handle is valid; the outputs live during the call.
        call(|| unsafe { sys::gpurt_buffer_get_data(owner.as_raw(), &mut data, &mut size) })?;
        Ok(DeviceBuffer { owner, data: data as *mut T, len, elements: PhantomData })
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        self.len
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Replaces all elements.
    pub fn upload(&mut self, elements: &[T]) -> Result<()> {
        if elements.len() != self.len {
            return Err(Error::InvalidArgument(format!(
                "elements has {} elements; the buffer has {}: use upload_at for a part of it",
                elements.len(),
                self.len
            )));
        }
        self.upload_at(0, elements)
    }

    /// Replaces the elements from `first` on.
    pub fn upload_at(&mut self, first: usize, elements: &[T]) -> Result<()> {
        let (offset, size) = self.part(first, elements.len())?;
        let data = elements.as_ptr() as *const c_void;
        // SAFETY: the handle is valid; `data` has `size` bytes, without padding.
        call(|| unsafe { sys::gpurt_buffer_write(self.as_raw(), offset, data, size) })
    }

    /// The elements, in host memory.
    pub fn download(&self) -> Result<Vec<T>> {
        let mut elements = Vec::with_capacity(self.len);
        let (offset, size) = self.part(0, self.len)?;
        let data = elements.as_mut_ptr() as *mut c_void;
        // SAFETY: the handle is valid; there is room for `size` bytes at `data`.
        call(|| unsafe { sys::gpurt_buffer_read(self.as_raw(), offset, data, size) })?;
        // SAFETY: all elements were written, and any bytes are a value.
        unsafe { elements.set_len(self.len) };
        Ok(elements)
    }

    /// Copies the elements from `first` on.
    pub fn download_into(&self, first: usize, elements: &mut [T]) -> Result<()> {
        let (offset, size) = self.part(first, elements.len())?;
        let data = elements.as_mut_ptr() as *mut c_void;
        // SAFETY: the handle is valid; `data` has `size` bytes, and any bytes are a value.
        call(|| unsafe { sys::gpurt_buffer_read(self.as_raw(), offset, data, size) })
    }

    /// Offset and size in bytes.
    fn part(&self, first: usize, len: usize) -> Result<(u64, u64)> {
        match first.checked_add(len) {
            Some(end) if end <= self.len => Ok(((first * size_of::<T>()) as u64, (len * size_of::<T>()) as u64)),
            _ => Err(Error::InvalidArgument(format!(
                "{} elements from {} on leave the buffer, which has {}",
                len, first, self.len
            ))),
        }
    }

    /// The address of the first element, in device memory. Using it is up to the caller, and so is the order of that and
    /// what this object does.
    pub fn as_device_ptr(&self) -> *mut T {
        self.data
    }

    /// The handle, for calls of [`sys`]. This object keeps its reference.
    pub fn as_raw(&self) -> sys::gpurt_buffer {
        self.owner.as_raw()
    }

    pub(crate) fn callbacks(&self) -> &Callbacks {
        self.owner.callbacks()
    }
}

impl Owner {
    fn callbacks(&self) -> &Callbacks {
        &self.callbacks
    }
}

impl<T: Pod> fmt::Debug for DeviceBuffer<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "DeviceBuffer({:p}, {} elements)", self.data, self.len)
    }
}

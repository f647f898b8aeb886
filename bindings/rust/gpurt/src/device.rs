//! Devices.
use std::fmt;
use std::ptr;
use std::sync::Arc;

use crate::callback::{self, call, Callbacks, Closure, LogFn, Registration};
use crate::macros::text;
use crate::{sys, DeviceType, LogLevel, Result};

handle! {
    /// What renders and traces: the CPU or a GPU.
    Device: gpurt_device, gpurt_device_retain, gpurt_device_release
}

/// How a device is created. `DeviceDesc::new(DeviceType::Auto)` is the default.
#[derive(Clone)]
#[must_use]
pub struct DeviceDesc {
    kind: DeviceType,
    ordinals: Vec<u32>,
    num_threads: u32,
    memory_limit_bytes: u64,
    log: Option<LogFn>,
}

impl DeviceDesc {
    /// Describes a device of the given kind.
    pub fn new(kind: DeviceType) -> Self {
        DeviceDesc { kind, ordinals: Vec::new(), num_threads: 0, memory_limit_bytes: 0, log: None }
    }

    /// Which CUDA device; 0 is the first.
    pub fn ordinal(mut self, ordinal: u32) -> Self {
        self.ordinals = vec![ordinal];
        self
    }

    /// Several CUDA devices that work as one: a scene is built on each of them, and they share the work of every frame
    /// and of rays in host memory. The results have the bits of one device.
    pub fn ordinals(mut self, ordinals: &[u32]) -> Self {
        self.ordinals = ordinals.to_vec();
        self
    }

    /// CPU worker threads; 0: all that the process may use.
    pub fn threads(mut self, num_threads: u32) -> Self {
        self.num_threads = num_threads;
        self
    }

    /// Memory of all scenes, frames and working memory of each device; 0: no limit.
    pub fn memory_limit(mut self, bytes: u64) -> Self {
        self.memory_limit_bytes = bytes;
        self
    }

    /// Receives messages of the device, from any thread, as long as the device or anything made from it
    /// lives.
    ///
    /// The closure cannot call gpurt: fallible functions return an error there. If it panics, it is not
    /// called again.
    pub fn log(mut self, log: impl Fn(LogLevel, &str) + Send + Sync + 'static) -> Self {
        self.log = Some(Arc::new(log));
        self
    }

    /// Creates the device.
    pub fn create(&self) -> Result<Device> {
        let mut desc = sys::gpurt_device_desc {
            type_: self.kind as u32,
            num_threads: self.num_threads,
            memory_limit_bytes: self.memory_limit_bytes,
            ..Default::default()
        };
        match self.ordinals[..] {
            [] => {}
            [ordinal] => desc.ordinal = ordinal, // also where the library would refuse a list
            _ => {
                desc.ordinals = self.ordinals.as_ptr();
                desc.num_ordinals = self.ordinals.len() as u32;
            }
        }
        let mut callbacks = Callbacks::default();
        if let Some(log) = &self.log {
            let registration = Registration::new(Closure::Log(log.clone()));
            desc.log = Some(callback::log);
            desc.log_user = registration.user();
            callbacks.push(registration);
        }
        let mut device = ptr::null_mut();
        // SAFETY: the descriptor and the output live during the call.
        call(|| unsafe { sys::gpurt_device_create(&desc, &mut device) })?;
        callbacks.set_device(device);
        Ok(Device::own(device, callbacks))
    }
}

impl Default for DeviceDesc {
    fn default() -> Self {
        DeviceDesc::new(DeviceType::Auto)
    }
}

impl fmt::Debug for DeviceDesc {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("DeviceDesc")
            .field("kind", &self.kind)
            .field("ordinals", &self.ordinals)
            .field("num_threads", &self.num_threads)
            .field("memory_limit_bytes", &self.memory_limit_bytes)
            .field("log", &self.log.is_some())
            .finish()
    }
}

impl Device {
    /// The first CUDA device that works, else the CPU.
    pub fn new() -> Result<Self> {
        DeviceDesc::default().create()
    }

    /// The CPU, on all its threads.
    pub fn cpu() -> Result<Self> {
        DeviceDesc::new(DeviceType::Cpu).create()
    }

    /// A CUDA device; 0 is the first.
    pub fn cuda(ordinal: u32) -> Result<Self> {
        DeviceDesc::new(DeviceType::Cuda).ordinal(ordinal).create()
    }

    /// Several CUDA devices that work as one; see [`DeviceDesc::ordinals`].
    pub fn cuda_several(ordinals: &[u32]) -> Result<Self> {
        DeviceDesc::new(DeviceType::Cuda).ordinals(ordinals).create()
    }

    /// Lists the devices of this machine: the CPU first, then CUDA devices by ordinal.
    pub fn enumerate() -> Result<Vec<DeviceProperties>> {
        let mut count = 0;
        // SAFETY: with capacity 0 nothing but the count is written.
        call(|| unsafe { sys::gpurt_device_enumerate(ptr::null_mut(), 0, &mut count) })?;
        let mut devices = vec![sys::gpurt_device_properties::default(); count as usize];
        // SAFETY: there are `count` elements, with their struct_size set.
        call(|| unsafe { sys::gpurt_device_enumerate(devices.as_mut_ptr(), count, &mut count) })?;
        devices.iter().take(count as usize).map(DeviceProperties::from_raw).collect()
    }

    /// What the device is and how much memory it holds now.
    pub fn properties(&self) -> Result<DeviceProperties> {
        let mut raw = sys::gpurt_device_properties::default();
        // SAFETY: the handle is valid; the output lives during the call.
        call(|| unsafe { sys::gpurt_device_get_properties(self.raw, &mut raw) })?;
        DeviceProperties::from_raw(&raw)
    }

    pub(crate) fn callbacks(&self) -> &Callbacks {
        &self.callbacks
    }
}

filled_struct! {
    /// What a device is.
    DeviceProperties: gpurt_device_properties as raw {
        same {
            /// Which CUDA device.
            ordinal: u32,
            /// CPU: worker threads; CUDA: multiprocessors.
            num_threads: u32,
            /// Physical memory of the device.
            memory_bytes: u64,
            /// 0: none.
            memory_limit_bytes: u64,
            /// Held now by scenes, frames and jobs of this device object.
            memory_used_bytes: u64,
            /// The largest that `memory_used_bytes` has been.
            memory_peak_bytes: u64,
            /// CUDA: 90 for 9.0; CPU: 0.
            compute_capability: u32,
        }
        converted {
            /// CPU or CUDA.
            kind: DeviceType = DeviceType::from_raw(raw.type_)?,
            /// The product's name.
            name: String = text(&raw.name),
            /// CPU: the variant in use, such as `x86_64_v3`; CUDA: `sm_90`.
            instruction_set: String = text(&raw.instruction_set),
        }
    }
}

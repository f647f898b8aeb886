//! The enums of the ABI.

c_enum! {
    /// The kind of a device.
    DeviceType {
        /// The first CUDA device that works, else the CPU.
        Auto = GPURT_DEVICE_AUTO,
        /// The CPU.
        Cpu = GPURT_DEVICE_CPU,
        /// A CUDA GPU.
        Cuda = GPURT_DEVICE_CUDA,
    }
}

c_enum! {
    /// How much a log message matters.
    LogLevel {
        /// Something failed.
        Error = GPURT_LOG_ERROR,
        /// Something may not be as the caller expects.
        Warning = GPURT_LOG_WARNING,
        /// What the library does.
        Info = GPURT_LOG_INFO,
    }
}

c_enum! {
    /// What lies beyond the edge of a texture.
    Wrap {
        /// The texture again.
        Repeat = GPURT_WRAP_REPEAT,
        /// The texels of the edge.
        Clamp = GPURT_WRAP_CLAMP,
        /// The texture, mirrored every other time.
        Mirror = GPURT_WRAP_MIRROR,
    }
}

c_enum! {
    /// How a texture is looked up between texel centres.
    Filter {
        /// Bilinear, texel centres at (i + 0.5) / size.
        Linear = GPURT_FILTER_LINEAR,
        /// The texel that the point lies in.
        Nearest = GPURT_FILTER_NEAREST,
    }
}

c_enum! {
    /// How a surface scatters light.
    MaterialType {
        /// Base colour / pi, on both sides.
        Lambert = GPURT_MATERIAL_LAMBERT,
        /// Perfect mirror, reflectance is the base colour.
        Mirror = GPURT_MATERIAL_MIRROR,
        /// Smooth dielectric, exact Fresnel; closed solids; base colour tints transmission.
        Glass = GPURT_MATERIAL_GLASS,
        /// GGX, alpha = roughness², separable Smith, Schlick Fresnel with F0 = base colour.
        Metal = GPURT_MATERIAL_METAL,
    }
}

c_enum! {
    /// The rule of a subdivision surface.
    SubdivisionScheme {
        /// Quadrilaterals above all.
        CatmullClark = GPURT_SUBDIVISION_CATMULL_CLARK,
        /// Triangles.
        Loop = GPURT_SUBDIVISION_LOOP,
    }
}

c_enum! {
    /// The projection of a camera.
    CameraType {
        /// Through a point.
        Perspective = GPURT_CAMERA_PERSPECTIVE,
        /// In parallel. This version of the library does not support it.
        Orthographic = GPURT_CAMERA_ORTHOGRAPHIC,
    }
}

c_enum! {
    /// The acceleration structure of a scene.
    Accel {
        /// CUDA: bvh; CPU: Embree; either: the kd-tree where an imported tree or a setting of it is there.
        Auto = GPURT_ACCEL_AUTO,
        /// The same bits on every backend.
        Kdtree = GPURT_ACCEL_KDTREE,
        /// CPU alone; not the same bits; rare leaks at vertices.
        Embree = GPURT_ACCEL_EMBREE,
        /// 2-wide, with spatial splits; the same bits on every backend.
        Bvh = GPURT_ACCEL_BVH,
    }
}

c_enum! {
    /// How much time building an acceleration structure may take.
    BuildQuality {
        /// `High`: the same tree, and so the same bits, on every device.
        Auto = GPURT_BUILD_QUALITY_AUTO,
        /// CUDA: large trees are built on the device, in milliseconds a million triangles. Hits are the same, but by
        /// Moeller and Trumbore's test, by which a ray that grazes triangles may meet another one of them. Elsewhere as `High`.
        Fast = GPURT_BUILD_QUALITY_FAST,
        /// The tree that traces fastest, built on the host's threads.
        High = GPURT_BUILD_QUALITY_HIGH,
    }
}

c_enum! {
    /// The intersection test of a ray and a triangle.
    TriangleTest {
        /// Woop, Benthin and Wald 2013; Embree: its robust mode.
        Watertight = GPURT_TRIANGLE_WATERTIGHT,
        /// Leaks at edges; Embree: its fast mode.
        MollerTrumbore = GPURT_TRIANGLE_MOLLER_TRUMBORE,
        /// The watertight test in double precision; not Embree.
        Double = GPURT_TRIANGLE_DOUBLE,
    }
}

c_enum! {
    /// The method that renders.
    Pipeline {
        /// Path tracing, until there is a planner.
        Auto = GPURT_PIPELINE_AUTO,
        /// Path tracing.
        Path = GPURT_PIPELINE_PATH,
        /// Photon mapping.
        Photon = GPURT_PIPELINE_PHOTON,
        /// Micropolygons, with a depth of at most 2 in this version of the library.
        Reyes = GPURT_PIPELINE_REYES,
        /// Micropolygons and rays. This version of the library does not support it.
        Hybrid = GPURT_PIPELINE_HYBRID,
    }
}

c_enum! {
    /// What photons within the radius count.
    PhotonKernel {
        /// `Constant`.
        Auto = GPURT_PHOTON_KERNEL_AUTO,
        /// All alike.
        Constant = GPURT_PHOTON_KERNEL_CONSTANT,
        /// Falls linearly to 0 at the radius: sharper, noisier.
        Cone = GPURT_PHOTON_KERNEL_CONE,
    }
}

c_enum! {
    /// How photons become radiance.
    PhotonEstimator {
        /// `Memoryless`.
        Auto = GPURT_PHOTON_ESTIMATOR_AUTO,
        /// A radius that depends on the pass alone: passes can be merged, and shared by devices.
        Memoryless = GPURT_PHOTON_ESTIMATOR_MEMORYLESS,
        /// Each pixel keeps its radius, photons and flux. With the constant kernel alone.
        PerPixel = GPURT_PHOTON_ESTIMATOR_PER_PIXEL,
        /// A radius for each pixel, by its blur and noise so far.
        Adaptive = GPURT_PHOTON_ESTIMATOR_ADAPTIVE,
    }
}

c_enum! {
    /// What photon mapping does about photons of other surfaces, and about surfaces that end.
    PhotonRemedy {
        /// Leave out photons on surfaces that are turned away: corners.
        Normal = GPURT_PHOTON_REMEDY_NORMAL,
        /// Leave out photons off the plane of the visible point: steps, thin walls.
        Plane = GPURT_PHOTON_REMEDY_PLANE,
        /// Leave out photons that came to the other side: leaks.
        Side = GPURT_PHOTON_REMEDY_SIDE,
        /// Divide by the part of the disc that lies on a surface: dark rims. Costs rays.
        Boundary = GPURT_PHOTON_REMEDY_BOUNDARY,
        /// Follow paths past points that other surfaces are nearer to than the radius, and gather later: light under
        /// walls. Costs 8 short rays a visible point; without settings it is off.
        Continue = GPURT_PHOTON_REMEDY_CONTINUE,
    }
}

c_enum! {
    /// How samples of REYES become pixels.
    ReyesFilter {
        /// `Box`.
        Auto = GPURT_REYES_FILTER_AUTO,
        /// The mean over the pixel's square.
        Box = GPURT_REYES_FILTER_BOX,
        /// Radius 1.5 pixels.
        Gaussian = GPURT_REYES_FILTER_GAUSSIAN,
        /// Mitchell and Netravali 1988, B = C = 1/3: sharper, may overshoot.
        Mitchell = GPURT_REYES_FILTER_MITCHELL,
    }
}

c_enum! {
    /// Where REYES computes light: after visibility in every case.
    ReyesShading {
        /// `Samples`.
        Auto = GPURT_REYES_SHADING_AUTO,
        /// At every sample.
        Samples = GPURT_REYES_SHADING_SAMPLES,
        /// Once for each micropolygon, before it is sampled: direct light without shadows, of patches alone.
        Micropolygons = GPURT_REYES_SHADING_MICROPOLYGONS,
        /// Once for each 2 x 2 of them.
        Blocks = GPURT_REYES_SHADING_BLOCKS,
    }
}

c_enum! {
    /// What a frame keeps for each pixel; [`Frame::read`](crate::Frame::read) reads it as the type named
    /// here.
    Output {
        /// `[f32; 3]`: radiance, the mean over samples.
        Color = GPURT_OUTPUT_COLOR,
        /// `f32`: share of samples whose eye ray hit something.
        Alpha = GPURT_OUTPUT_ALPHA,
        /// `f32`: distance from the camera's plane, first sample; infinite where nothing is hit.
        Depth = GPURT_OUTPUT_DEPTH,
        /// `[f32; 3]`: shading normal towards the viewer, the mean over samples.
        Normal = GPURT_OUTPUT_NORMAL,
        /// `[f32; 3]`: reflectance of the first surface, the mean over samples.
        Albedo = GPURT_OUTPUT_ALBEDO,
        /// `[f32; 3]`: world position, first sample; 0 where nothing is hit.
        Position = GPURT_OUTPUT_POSITION,
        /// `u32`: first sample; [`INVALID_ID`](crate::INVALID_ID) where nothing is hit.
        Primitive = GPURT_OUTPUT_PRIMITIVE,
        /// `u32`: first sample; [`INVALID_ID`](crate::INVALID_ID) where nothing is hit.
        Instance = GPURT_OUTPUT_INSTANCE,
        /// `u32`: number of samples.
        SampleCount = GPURT_OUTPUT_SAMPLE_COUNT,
        /// `[f32; 3]`: variance of the colour, from two independent halves; infinite while one
        /// is empty.
        Variance = GPURT_OUTPUT_VARIANCE,
        /// This version of the library does not support it.
        Time = GPURT_OUTPUT_TIME,
        /// `[f32; 3]`: what the blur of photon mapping adds to the colour on average, estimated. Other pipelines do not
        /// have it.
        Bias = GPURT_OUTPUT_BIAS,
        /// `[f32; 3]`: what blur and noise of photon mapping move the colour by: at most, with 95 % confidence. Other
        /// pipelines do not have it.
        Error = GPURT_OUTPUT_ERROR,
    }
}

c_enum! {
    /// The way of rays through a tree on a CUDA device.
    Traversal {
        /// The library's choice.
        Auto = GPURT_TRAVERSAL_AUTO,
        /// One kernel: down to a leaf, its triangles, on from the stack.
        Stack = GPURT_TRAVERSAL_STACK,
        /// Of kd-trees: one kernel selects leaves, another tests them, in turn.
        LeafLists = GPURT_TRAVERSAL_LEAF_LISTS,
        /// One kernel whose warps switch between kinds of work.
        Uber = GPURT_TRAVERSAL_UBER,
    }
}

c_enum! {
    /// How many threads a CUDA kernel has.
    Launch {
        /// The library's choice.
        Auto = GPURT_LAUNCH_AUTO,
        /// One for every ray.
        Regular = GPURT_LAUNCH_REGULAR,
        /// As many as the device holds, which draw rays from a pool.
        Persistent = GPURT_LAUNCH_PERSISTENT,
        /// REYES alone: one launch whose threads wait for each other after every round of cutting.
        Rounds = GPURT_LAUNCH_ROUNDS,
    }
}

c_enum! {
    /// Who loads the triangles that rays are tested against.
    Fetch {
        /// The library's choice.
        Auto = GPURT_FETCH_AUTO,
        /// Every thread for itself.
        PerThread = GPURT_FETCH_PER_THREAD,
        /// Of kd-trees: a warp for all of its rays, which traverse together.
        Packets = GPURT_FETCH_PACKETS,
    }
}

c_enum! {
    /// How the rays that are there are moved together. REYES: also how pieces that a level of [`Launch::Regular`] has cut find
    /// their places in the queue; `Auto`: they are pushed, by atomic additions.
    Compaction {
        /// The library's choice.
        Auto = GPURT_COMPACTION_AUTO,
        /// Counts of blocks and a scan over these.
        BlockScan = GPURT_COMPACTION_BLOCK_SCAN,
        /// Histogram pyramid.
        Pyramid = GPURT_COMPACTION_PYRAMID,
        /// The scan of n log n additions.
        NaiveScan = GPURT_COMPACTION_NAIVE_SCAN,
        /// The scan of the CUDA core libraries.
        LibraryScan = GPURT_COMPACTION_LIBRARY_SCAN,
    }
}

c_enum! {
    /// In which order hits are shaded.
    Shading {
        /// The library's choice.
        Auto = GPURT_SHADING_AUTO,
        /// As the rays lie.
        Immediate = GPURT_SHADING_IMMEDIATE,
        /// By material.
        Sorted = GPURT_SHADING_SORTED,
    }
}

c_enum! {
    /// How shading makes rays.
    Generation {
        /// The library's choice.
        Auto = GPURT_GENERATION_AUTO,
        /// Into slots, of which the empty ones are removed.
        Slots = GPURT_GENERATION_SLOTS,
        /// They are counted first, then exactly these are made.
        Counted = GPURT_GENERATION_COUNTED,
        /// Without gaps, and new paths start where others have ended.
        Refilled = GPURT_GENERATION_REFILLED,
    }
}

c_enum! {
    /// The weight of a point at distance d of a radius r.
    GatherKernel {
        /// 1.
        Constant = GPURT_GATHER_KERNEL_CONSTANT,
        /// 1 - d / r.
        Cone = GPURT_GATHER_KERNEL_CONE,
        /// 1 - d² / r².
        Quadratic = GPURT_GATHER_KERNEL_QUADRATIC,
    }
}

c_enum! {
    /// What a map keeps of each point.
    PhotonAttribute {
        /// Where it is.
        Position = GPURT_PHOTON_ATTRIBUTE_POSITION,
        /// As it counts in sums.
        Flux = GPURT_PHOTON_ATTRIBUTE_FLUX,
        /// In steps of 1/127, of about unit length, or 0.
        Normal = GPURT_PHOTON_ATTRIBUTE_NORMAL,
        /// Of flight, unit length.
        Direction = GPURT_PHOTON_ATTRIBUTE_DIRECTION,
    }
}

c_enum! {
    /// How points within a radius are found.
    GatherMethod {
        /// In the cells of a grid.
        Grid = GPURT_GATHER_GRID,
        /// In lists of those within the radius of a kd-tree's leaves: a reference to compare with.
        NodeLists = GPURT_GATHER_NODE_LISTS,
    }
}

c_enum! {
    /// How rays that follow one another in a batch go. Changes the speed on CUDA devices alone, never a result.
    Coherence {
        /// By the tree's size, or a look at a few of the rays.
        Auto = GPURT_COHERENCE_AUTO,
        /// Nearly the same way, as those of a camera's neighbouring pixels.
        Coherent = GPURT_COHERENCE_COHERENT,
        /// Apart, as those that surfaces scatter.
        Incoherent = GPURT_COHERENCE_INCOHERENT,
    }
}

// The mapper's kernel: whole training steps and queries. One translation unit, compiled once per instruction set, see
// CMakeLists.txt.
#include "frame_to_field.h"
#include "frame_to_frame.h"
#include "query.h"
#include "roofline.h"
#include "sensitivity.h"
#include "step.h"
#include "view.h"

#ifndef ANM_KERNEL
#define ANM_KERNEL generic
#endif
#define ANM_JOIN_(a, b) a##b
#define ANM_JOIN(a, b) ANM_JOIN_(a, b)
#define ANM_STRING_(a) #a
#define ANM_STRING(a) ANM_STRING_(a)

namespace {

const anm::Kernel kKernel = {ANM_STRING(ANM_KERNEL), step, sample, query, hidden, sensitivity, render, align, frame_to_frame,
                             measure_roofline};

}  // namespace

namespace anm {

const Kernel& ANM_JOIN(kernel_, ANM_KERNEL)() { return kKernel; }

}  // namespace anm

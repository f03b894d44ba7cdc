// Python's view of the native code.
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "bindings.h"

// Names of the kernels that this processor can run, best first.
std::vector<std::string> kernel_names() {
    std::vector<std::string> names;
#ifdef ANM_X86
    __builtin_cpu_init();
    const bool v2 =
        __builtin_cpu_supports("sse4.2") && __builtin_cpu_supports("popcnt") && __builtin_cpu_supports("ssse3");
    const bool v3 = v2 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    if (v4) names.emplace_back("v4");
    if (v3) names.emplace_back("v3");
    if (v2) names.emplace_back("v2");
#else
    names.emplace_back("generic");
#endif
    return names;
}

const anm::Kernel& find_kernel(const std::string& name) {
    for (const std::string& known : kernel_names()) {
        if (!name.empty() && name != known) continue;
#ifdef ANM_X86
        if (known == "v4") return anm::kernel_v4();
        if (known == "v3") return anm::kernel_v3();
        if (known == "v2") return anm::kernel_v2();
#else
        return anm::kernel_generic();
#endif
    }
    throw nb::value_error(("this processor cannot run the kernel '" + name + "'").c_str());
}

NB_MODULE(_native, m) {
    m.def("kernel_names", &kernel_names);
    bind_engine(m);
    bind_occupancy(m);
    bind_functions(m);
    bind_planning(m);
    bind_localisation(m);
}

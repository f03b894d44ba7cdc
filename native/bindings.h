// What the bindings share: arrays, checks, and which kernel this processor runs. Compiled for the oldest processor of
// the platform.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstdint>
#include <string>
#include <vector>

#include "kernel.h"

namespace nb = nanobind;
using namespace nb::literals;

template <class T, std::size_t N>
using Array = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
using In = Array<const float, 2>;
using InFlat = Array<const float, 1>;
using InFlags = Array<const std::uint8_t, 1>;
using Out = nb::ndarray<nb::numpy, float>;
using Doubles = nb::ndarray<nb::numpy, double>;
using Flags = nb::ndarray<nb::numpy, std::uint8_t>;

inline void require(bool ok, const char* message) {
    if (!ok) throw nb::value_error(message);
}

template <std::size_t N>
Out make_array(const std::size_t (&shape)[N], float*& data) {
    std::size_t size = 1;
    for (std::size_t extent : shape) size *= extent;
    data = new float[size > 0 ? size : 1];
    return Out(data, N, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<float*>(p); }));
}

template <std::size_t N>
Doubles make_doubles(const std::size_t (&shape)[N], double*& data) {
    std::size_t size = 1;
    for (std::size_t extent : shape) size *= extent;
    data = new double[size > 0 ? size : 1];
    return Doubles(data, N, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<double*>(p); }));
}

// Normal equations of two kinds of residuals: matrices, gradients, and cost, weight and count of each.
inline nb::tuple as_arrays(const anm::NormalEquations (&sums)[2]) {
    double *hessian = nullptr, *gradient = nullptr, *facts = nullptr;
    Doubles hessian_out = make_doubles({2, 6, 6}, hessian), gradient_out = make_doubles({2, 6}, gradient);
    Doubles facts_out = make_doubles({2, 3}, facts);
    for (std::size_t kind = 0; kind < 2; ++kind) {
        const anm::NormalEquations& of = sums[kind];
        std::size_t k = 0;
        for (std::size_t i = 0; i < 6; ++i) {
            gradient[6 * kind + i] = of.gradient[i];
            for (std::size_t j = i; j < 6; ++j) {
                hessian[36 * kind + 6 * i + j] = hessian[36 * kind + 6 * j + i] = of.hessian[k++];
            }
        }
        facts[3 * kind] = of.cost;
        facts[3 * kind + 1] = of.weight;
        facts[3 * kind + 2] = of.count;
    }
    return nb::make_tuple(hessian_out, gradient_out, facts_out);
}

// Names of the kernels that this processor can run, best first.
std::vector<std::string> kernel_names();
// The kernel of that name; the best one for an empty name.
const anm::Kernel& find_kernel(const std::string& name);

// Each adds its classes or functions to the module.
void bind_engine(nb::module_& m);
void bind_occupancy(nb::module_& m);
void bind_functions(nb::module_& m);
void bind_planning(nb::module_& m);
void bind_localisation(nb::module_& m);

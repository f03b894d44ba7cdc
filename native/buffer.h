// Zeroed memory in large pages, where the system gives them, and what a kernel works with: such memory and threads.
#pragma once

#if defined(__linux__)
#include <sys/mman.h>
#endif

#include <cstdlib>
#include <cstring>
#include <map>
#include <memory>
#include <new>

#include "kernel.h"
#include "thread_pool.h"

// Large pages, where the system gives them to those who ask: tables are read at random, and fewer pages are looked up.
constexpr std::size_t kLargePage = std::size_t{1} << 21;

class Buffer {
public:
    explicit Buffer(std::size_t bytes) {
        const std::size_t alignment = bytes < kLargePage ? 64 : kLargePage;
        bytes_ = (bytes + 64 + alignment - 1) / alignment * alignment;
        data_ = std::aligned_alloc(alignment, bytes_);
        if (data_ == nullptr) throw std::bad_alloc();
#if defined(__linux__)
        // A refusal costs speed alone.
        if (alignment == kLargePage) madvise(data_, bytes_, MADV_HUGEPAGE);
#endif
        std::memset(data_, 0, bytes_);
    }
    ~Buffer() { std::free(data_); }
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    void* data() const { return data_; }
    float* floats() const { return static_cast<float*>(data_); }
    std::size_t bytes() const { return bytes_; }
    void clear() { std::memset(data_, 0, bytes_); }

private:
    std::size_t bytes_ = 0;
    void* data_ = nullptr;
};

// The threads and the memory that the kernels of one object work with.
class Workspace {
public:
    explicit Workspace(int num_threads) : threads_(num_threads) {}
    int num_threads() const { return threads_; }

    anm::Parallel parallel() {
        return {[](void* self, int count, void (*fn)(void*, int, int), void* arg) {
                    anm::thread_pool().run(static_cast<Workspace*>(self)->threads_, count, fn, arg);
                },
                this, threads_};
    }

    anm::Arena arena() {
        return {this, [](void* self, int key, std::size_t bytes) {
                    auto& slot = static_cast<Workspace*>(self)->buffers_[key];
                    if (!slot || slot->bytes() < bytes) slot = std::make_unique<Buffer>(bytes);
                    return slot->data();
                }};
    }

private:
    int threads_;
    std::map<int, std::unique_ptr<Buffer>> buffers_;
};

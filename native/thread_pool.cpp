#include "thread_pool.h"

#include <unistd.h>

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

namespace anm {
namespace {

constexpr int kSpins = 4000;  // some tens of microseconds: the pauses between the phases of a step

void pause() {
#if defined(__x86_64__)
    _mm_pause();
#endif
}

// Moments of entries that are seen no more decay into denormal numbers, which some processors are very slow with.
class FlushDenormals {
public:
#if defined(__x86_64__)
    FlushDenormals() : saved_(_mm_getcsr()) { _mm_setcsr(saved_ | 0x8040U); }
    ~FlushDenormals() { _mm_setcsr(saved_); }

private:
    unsigned saved_;
#else
    FlushDenormals() {}
#endif
};

}  // namespace

void ThreadPool::run(int workers, int count, Task fn, void* arg) {
    const FlushDenormals flush;
    workers -= lent_.load(std::memory_order_relaxed);
    if (workers > count) workers = count;
    std::unique_lock<std::mutex> user(user_, std::defer_lock);
    if (workers <= 1 || !user.try_lock()) {
        for (int task = 0; task < count; ++task) fn(arg, task, 0);
        return;
    }
    {
        const std::lock_guard<std::mutex> lock(mutex_);
        while (static_cast<int>(threads_.size()) < workers - 1) {
            const int worker = static_cast<int>(threads_.size()) + 1;
            threads_.emplace_back([this, worker] { work(worker); });
            threads_.back().detach();
        }
        count_ = count;
        workers_ = workers;
        fn_ = fn;
        arg_ = arg;
        next_.store(0);
        running_.store(static_cast<int>(threads_.size()));
        batch_.fetch_add(1);
    }
    wake_.notify_all();
    take_tasks(0);
    // Every thread reports back, so that none can meet the next batch half-way.
    for (int spin = 0; spin < kSpins && running_.load() != 0; ++spin) pause();
    if (running_.load() == 0) return;
    // A thread that has lost its core to somebody else takes milliseconds: waiting for it awake would cost as much.
    std::unique_lock<std::mutex> lock(mutex_);
    waiting_.store(true);
    done_.wait(lock, [this] { return running_.load() == 0; });
    waiting_.store(false);
}

void ThreadPool::take_tasks(int worker) {
    if (worker >= workers_) return;
    for (int task = next_.fetch_add(1); task < count_; task = next_.fetch_add(1)) fn_(arg_, task, worker);
}

void ThreadPool::work(int worker) {
    const FlushDenormals flush;
    std::uint64_t seen = 0;
    while (true) {
        for (int spin = 0; spin < kSpins && batch_.load() == seen; ++spin) pause();
        {
            std::unique_lock<std::mutex> lock(mutex_);
            wake_.wait(lock, [&] { return batch_.load() != seen; });
            seen = batch_.load();
        }
        take_tasks(worker);
        // Whoever sees the last one done without having waited goes on at once; one that waits is told.
        if (running_.fetch_sub(1) == 1 && waiting_.load()) {
            const std::lock_guard<std::mutex> lock(mutex_);
            done_.notify_one();
        }
    }
}

ThreadPool& thread_pool() {
    static std::mutex mutex;
    static ThreadPool* pool = nullptr;
    static pid_t owner = 0;
    const std::lock_guard<std::mutex> lock(mutex);
    if (pool == nullptr || owner != getpid()) {
        // Never freed: its threads may still wait in it when the process ends.
        pool = new ThreadPool;
        owner = getpid();
    }
    return *pool;
}

}  // namespace anm

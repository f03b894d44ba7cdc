// Threads that wait for the next batch of tasks; one pool per process, shared by all engines.
#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <mutex>
#include <thread>
#include <vector>

namespace anm {

class ThreadPool {
public:
    using Task = void (*)(void* arg, int task, int worker);

    // Uses at most `workers` threads, the caller's included; starts those that are missing. Runs everything in the
    // caller's thread when another thread is using the pool.
    void run(int workers, int count, Task fn, void* arg);

    // So many cores are somebody else's from now on: batches are computed by as many threads less, at least by one.
    void lend(int cores) { lent_.store(cores); }

private:
    void work(int worker);
    void take_tasks(int worker);

    std::vector<std::thread> threads_;
    std::mutex user_;
    std::mutex mutex_;
    std::condition_variable wake_, done_;
    std::atomic<std::uint64_t> batch_{0};  // counts batches, so that a worker knows a new one
    std::atomic<int> next_{0};
    std::atomic<int> running_{0};
    std::atomic<bool> waiting_{false};  // whether the caller sleeps until all are done
    std::atomic<int> lent_{0};
    int count_ = 0, workers_ = 0;
    Task fn_ = nullptr;
    void* arg_ = nullptr;
};

// The process's pool; a new one after a fork, which takes threads away.
ThreadPool& thread_pool();

}  // namespace anm

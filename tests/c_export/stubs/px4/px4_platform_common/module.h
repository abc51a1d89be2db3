// As much of PX4 as the wrapper uses.
#pragma once
#include <px4_platform_common/px4_config.h>

#include <atomic>

#define PRINT_MODULE_USAGE_NAME(name, category)
#define PRINT_MODULE_USAGE_COMMAND(name)
#define PRINT_MODULE_USAGE_DEFAULT_COMMANDS()

template <class T>
class ModuleBase {
 public:
  static int main(int argc, char* argv[]) { return argc > 1 ? T::task_spawn(argc, argv) : T::print_usage(); }
  virtual ~ModuleBase() = default;

 protected:
  static constexpr int task_id_is_work_queue = -2;
  static std::atomic<T*> _object;
  static int _task_id;
  bool should_exit() const { return false; }
  static void exit_and_cleanup() {}
};

template <class T>
std::atomic<T*> ModuleBase<T>::_object{nullptr};
template <class T>
int ModuleBase<T>::_task_id = -1;

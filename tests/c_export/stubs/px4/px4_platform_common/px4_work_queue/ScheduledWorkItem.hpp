#pragma once
#include <cstdint>

namespace px4 {
struct wq_config_t {};
namespace wq_configurations {
static constexpr wq_config_t nav_and_controllers{};
}
class ScheduledWorkItem {
 protected:
  ScheduledWorkItem(const char*, const wq_config_t&) {}
  virtual ~ScheduledWorkItem() = default;
  void ScheduleOnInterval(uint32_t) {}
  void ScheduleClear() {}
  virtual void Run() = 0;
};
}  // namespace px4

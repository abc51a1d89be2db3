#include "fmus/shell/access.hpp"

#include <cstdio>

namespace rotordx {
namespace {

/// `name` or `name[index]`, as FMI 2 calls the element.
struct ElementName {
  char text[128];
  explicit ElementName(std::uint32_t offset) {
    const Variable& variable = variable_at(offset);
    if (variable.array) {
      std::snprintf(text, sizeof text, "%s[%u]", variable.name, static_cast<unsigned>(offset - variable.first + 1));
    } else {
      std::snprintf(text, sizeof text, "%s", variable.name);
    }
  }
};

}  // namespace

bool parameter_accepts(const Instance& instance, std::uint32_t offset, double value) {
  const ElementName name(offset);
  const Variable& variable = variable_at(offset);
  if (offset >= component.outputs) return fail(instance, "%s is an output and cannot be set", name.text);
  if (!std::isfinite(value)) return fail(instance, "%s cannot be %g: it must be finite", name.text, value);
  if (instance.clock.phase == Phase::kStep && !(component.tunable_parameters && offset != component.step_size)) {
    return fail(instance, "%s is a fixed parameter: it cannot change after initialisation", name.text);
  }
  if (value < variable.minimum || value > variable.maximum || (variable.enumeration && value != std::floor(value))) {
    return fail(instance, "%s cannot be %g: it must be in [%g, %g]", name.text, value, variable.minimum,
                variable.maximum);
  }
  return true;
}

bool refuse_reference(const Instance& instance, std::uint32_t reference) {
  return fail(instance, "value reference %u is not a variable of this type", static_cast<unsigned>(reference));
}

bool refuse_count(const Instance& instance, std::size_t value_count) {
  return fail(instance, "%zu values do not match the sizes of the variables", value_count);
}

}  // namespace rotordx

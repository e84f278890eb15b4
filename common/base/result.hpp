#pragma once
#include <string>
#include <utility>
#include <variant>

namespace ledgerline {

/// What a caller may have to decide by; everything else is `failed`.
enum class ErrorCode {
  failed,
  cancelled,  ///< by the function that was called back
};

/// What went wrong. `message` is for a person: what happened, to which drone, file or key, and what to do.
struct Error {
  std::string message;
  ErrorCode code = ErrorCode::failed;
};

/// A value or an Error; used across module edges instead of exceptions and bare bools.
template <typename T>
class [[nodiscard]] Result {
 public:
  Result(T value) : content_(std::in_place_index<0>, std::move(value)) {}      // NOLINT: implicit on purpose
  Result(Error error) : content_(std::in_place_index<1>, std::move(error)) {}  // NOLINT: implicit on purpose

  explicit operator bool() const { return content_.index() == 0; }
  bool ok() const { return content_.index() == 0; }

  T& value() & { return std::get<0>(content_); }
  const T& value() const& { return std::get<0>(content_); }
  T&& value() && { return std::get<0>(std::move(content_)); }
  T& operator*() & { return value(); }
  const T& operator*() const& { return value(); }
  T&& operator*() && { return std::move(*this).value(); }
  T* operator->() { return &value(); }
  const T* operator->() const { return &value(); }

  const Error& error() const { return std::get<1>(content_); }

 private:
  std::variant<T, Error> content_;
};

struct Done {};
/// For functions that only succeed or fail: `return done;`.
using Status = Result<Done>;
inline constexpr Done done{};

}  // namespace ledgerline

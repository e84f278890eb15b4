#pragma once
#include <Eigen/Core>
#include <array>
#include <deque>
#include <functional>

#include "common/msg/onboard.hpp"

namespace ledgerline::ground::motion {

using ledgerline::Response;

/// Estimates a Response online. The model, integrated from t1 to t2, is linear in gain, lag and wind, once the dead
/// time is given:
///
///     p(t2) - p(t1) = gain * integral of u from t1 - dead to t2 - dead  -  lag (v(t2) - v(t1))  +  w (t2 - t1)
///
/// so recursive least squares with exponential forgetting fit them (Ljung, System Identification, 11.2), for each of a
/// few dead times side by side; the one with the smallest squared error so far is taken. Both horizontal axes share
/// gain and lag; each has a wind. Nothing is learned, and nothing forgotten, while the sent velocity is steady. Bounded
/// in memory, work and results. Deterministic; one thread.
class ResponseEstimator {
 public:
  /// What a Response is kept within.
  static constexpr double min_gain = 0.4, max_gain = 2.0, min_lag_s = 0.08, max_lag_s = 0.8;
  static constexpr std::size_t candidates = 13;  ///< dead times of 0, 20, ... 240 ms
  static constexpr double candidate_step_s = 0.02;

  explicit ResponseEstimator(const Response& first);

  /// A measured position at its time; times must grow. `sent(t)`: horizontal velocity that the drone was sent, for
  /// times up to now. After a gap of more than 0.2 s the fit goes on with what comes after it.
  void add(TimeNs stamp_ns, const Eigen::Vector2d& position_m, const std::function<Eigen::Vector2d(TimeNs)>& sent);
  /// Forgets the positions so far, as after a pause or a jump: no window reaches across it. What was learned stays.
  void interrupt() { points_.clear(); }

  const Response& response() const { return response_; }
  /// Samples fitted so far.
  std::size_t fitted() const { return fitted_; }

 private:
  using Vector4 = Eigen::Matrix<double, 4, 1>;
  struct Fit {
    Vector4 parameters = Vector4::Zero();  ///< gain, lag, wind x, wind y
    Eigen::Matrix4d covariance = Eigen::Matrix4d::Identity();
    double squares = 0;  ///< of errors before each update, forgotten like the rest
    double weight = 0;
  };
  struct Point {
    TimeNs stamp_ns;
    Eigen::Vector2d position_m;
  };
  void fit(double span_s, const Eigen::Vector2d& moved, const Eigen::Vector2d& change,
           const std::array<Eigen::Vector2d, candidates>& sent);
  void choose();

  std::deque<Point> points_;
  std::array<Fit, candidates> fits_;
  Response response_;
  std::size_t fitted_ = 0;
};

}  // namespace ledgerline::ground::motion

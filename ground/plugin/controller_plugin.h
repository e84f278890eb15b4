/* A controller of your own in ground's place: plain C, so that any compiler and language can make one.
 *
 * A plug-in is a shared library with one function, ledgerline_controller(). Ground loads it (`./fly --controller
 * my.so`, or `[flight] controller` in ground.toml), as does `ledgerline fault run SCRIPT --controller my.so`. For each
 * drone create() is called once, when the drone stands ready for take-off:
 *
 *     create -> observe, plan, observe, plan ... (hovers at the origin)
 *            -> start -> observe, plan ... (flies the path) -> destroy
 *
 * Threads: all calls for one controller come from one thread, never two at a time; those for different controllers may
 * come from different threads (a fault run flies several scripts at once), so keep no state outside of what create()
 * made. A call must not block: while it runs, ground reads no state and sends no command, for any drone. It must not
 * throw.
 *
 * Units: SI. Frame: the map's, x east, y north, z up; yaw counter-clockwise from x. Times: nanoseconds of the drone
 * host's monotonic clock, which is not the clock of the process that this runs in: compare them with each other only.
 *
 * What comes back is looked at before it is sent: numbers must be finite, setpoints in order of time and within the
 * request. Otherwise the drone is landed, and the error says what was wrong. Whatever a plug-in says, link's own limits
 * (speed, acceleration, fence, age, separation) and its failsafe hold as well.
 */
#ifndef LEDGERLINE_CONTROLLER_PLUGIN_H
#define LEDGERLINE_CONTROLLER_PLUGIN_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Grows with every change of what follows; a library of another version is refused. */
#define LEDGERLINE_CONTROLLER_VERSION 1u

/* A corner of the path, absolute. The path is closed: from the last one straight back to the first, which is where the
 * drone stands. */
typedef struct {
  double x_m, y_m;
  double z_m;       /* height to fly at from here on */
  double speed_mps; /* at most, from here to the next */
} ledgerline_waypoint;

typedef struct {
  const char* drone;                    /* "tello1"; valid during create() only, as the waypoints are */
  const ledgerline_waypoint* waypoints; /* 3 or more */
  uint32_t waypoint_count;
  uint32_t laps;           /* asked for; start() says how far that is */
  double yaw_rad;          /* where the drone looks: to be kept */
  double max_speed_mps;    /* largest velocity that can be commanded */
  double max_gain_mps2;    /* how fast link lets the sent velocity change */
  double max_vertical_mps; /* up and down */
  int64_t pose_lost_ns;    /* with an older pose link brakes */
} ledgerline_task;

/* One sample of the drone, as it came through the ledger. */
typedef struct {
  int64_t stamp_ns;      /* when link made it */
  int64_t pose_stamp_ns; /* when the drone was there: older than stamp_ns; the same again while no new pose came */
  double position_m[3];
  double velocity_mps[3]; /* by the source of the pose */
  double yaw_rad;
  double sent_mps[3]; /* what link sent the drone, behind its limits */
  double sent_yaw_rate_radps;
  int64_t late_ns; /* by so much later than they say link flies setpoints now */
  int32_t braking; /* not 0: link flies no plan now */
} ledgerline_state;

typedef struct {
  int64_t at_ns;
  double velocity_mps[3];
  double yaw_rate_radps;
} ledgerline_setpoint;

#define LEDGERLINE_MAX_SETPOINTS 40

/* What plan() fills in. Each setpoint is flown from its moment until the next one's; the last one as long as the one
 * before it was, at most 0.5 s. */
typedef struct {
  ledgerline_setpoint setpoints[LEDGERLINE_MAX_SETPOINTS];
  uint32_t count;    /* 1 to LEDGERLINE_MAX_SETPOINTS */
  double progress_m; /* along the path since start(), laps counted on; the flight ends when this is start()'s end_m */
} ledgerline_plan;

typedef struct {
  uint32_t version; /* LEDGERLINE_CONTROLLER_VERSION */
  const char* name; /* for messages */
  /* NULL: cannot be flown; the drone does not take off. */
  void* (*create)(const ledgerline_task* task);
  /* The drone hovers at the origin: from `from_ns` on the path is flown, for `end_m` (laps, infinite where the flight
   * goes by time). */
  void (*start)(void* controller, int64_t from_ns, double end_m);
  /* Each state in flight, in their order. Several may come before the next plan(), or none. */
  void (*observe)(void* controller, const ledgerline_state* state);
  /* The plan that answers the newest state. It takes effect at `first_ns`, which never goes back; no setpoint may be
   * sooner, nor later than `last_ns`. Before start() it should keep the drone over the first waypoint. Not 0: no plan.
   */
  int (*plan)(void* controller, int64_t first_ns, int64_t last_ns, ledgerline_plan* plan);
  void (*destroy)(void* controller);
} ledgerline_controller_v1;

/* The one function that the library has: its table, which lives as long as the library is loaded. */
const ledgerline_controller_v1* ledgerline_controller(void);

#ifdef __cplusplus
}
#endif
#endif

!> What a scene can ask to be recorded, where it goes, and the log of events.
module lapwing_observers_records
  use, intrinsic :: ieee_arithmetic, only: ieee_value, ieee_quiet_nan
  use lapwing_kinds, only: wp
  use lapwing_codes, only: coast_flank, event_impact, event_engage, event_near_graze, event_kind
  use lapwing_hybrid_state, only: event_t
  use lapwing_observers_averages, only: averages_t, average_columns
  use lapwing_observers_deviations, only: deviations_t
  use lapwing_observers_speeds, only: speed_density_t
  use lapwing_observers_tangent, only: tangent_t
  use lapwing_system, only: max_states
  implicit none
  private
  public :: recorder_t, sums_t, start_recording, start_watching, watches_flights, waits_for_room
  public :: columns_of_averages, forget_cycle, log_has_room, log_line, is_arrival
  public :: flight_none, flight_whole
  public :: column_state, column_phi, column_counted, column_engages, column_chatter_ends
  public :: column_depth, column_visited
  public :: log_columns, cycle_columns, sample_columns, n_counters, max_flights, log_reserve

  !> Kind, cycle, t, phi, velocity before, after; depth of the flight before.
  integer, parameter :: log_columns = 7
  ! With the other states of a system that has more than phi and phi' behind them, and `averages`
  ! where they are wanted:
  integer, parameter :: cycle_columns = 17    !! see `close_cycle`; some of them by name:
  integer, parameter :: column_state = 2, column_phi = 3, column_counted = 7, column_engages = 11
  integer, parameter :: column_chatter_ends = 13, column_depth = 15, column_visited = 17
  integer, parameter :: sample_columns = 3    !! motion state, phi, phi'
  integer, parameter :: n_counters = 8        !! impact, release, engage, chatter end, by flank
  !> Counted impacts of one cycle saturate here, those of shallower flights not included.
  integer, parameter :: max_flights = 1024
  !> A segment adds its four events and, at most now and then, a near-graze per piece and flank.
  integer, parameter :: log_reserve = 64

  !> Of the flight under way: there is none, it was watched from its beginning or in part.
  integer, parameter :: flight_none = 0, flight_whole = 1, flight_in_part = 2

  !> What the statistics of a cycle still need when the cycle is cut.
  type :: sums_t
    integer :: n_log = 0                       !! lines in the log, also those it had no room for
    integer :: n_cycles = 0                    !! cycles closed
    integer :: next_sample = 1                 !! next sample of the history
    logical :: strobe_due = .true.             !! whether the cycle's first state is still to come
    real(wp) :: counter(n_counters) = 0        !! events of the cycle by kind
    real(wp) :: flight_depth = 0               !! deepest point of the flight in this cycle, rad
    real(wp) :: flight_depth_before = 0        !! and in the cycles before
    integer :: flight_known = flight_none      !! what is known of that flight: flight_*
    logical :: flights_watched = .false.       !! whether flights were watched up to here
    logical :: cycles_watched = .false.        !! and cycles
    real(wp) :: cycle_depth = 0                !! deepest point of the cycle so far, rad
    real(wp) :: back_penetration = 0           !! deepest point in the coast flank, rad
    integer :: states_visited = 0              !! bit k: motion state k
    real(wp) :: strobe(3) = 0                  !! motion state, phi, phi' at the cycle's beginning
    real(wp) :: strobe_others(max_states - 2) = 0   !! and the other states
    real(wp) :: grazes_known_to = -1           !! near-grazes of the arc up to here are logged
    integer :: n_flights = 0                   !! flights of the cycle ended by an impact
    real(wp) :: flight(max_flights) = 0        !! their depths, negative: at the coast flank
    real(wp) :: fastest = 0                    !! of all arrivals recorded, rad per tau
    type(averages_t) :: averages               !! integrals over the cycle so far
    type(tangent_t) :: tangent                 !! tangent map since the cycle began
  end type sums_t

  !> What is wanted, and where it goes.
  type :: recorder_t
    logical :: want_events = .false.           !! every event
    logical :: want_impacts = .false.          !! impacts alone
    logical :: want_grazes = .false.           !! near-grazes
    logical :: want_strobe = .false.           !! state at the beginning of each cycle
    logical :: want_cycles = .false.           !! statistics of each cycle
    logical :: want_tangent = .false.          !! tangent map of each cycle; wants the strobe too
    logical :: want_depths = .false.           !! depths of flights in the log
    logical :: want_averages = .false.         !! integrals over each cycle; wants the cycles too
    logical :: want_unfinished = .false.       !! where a run ends, the cycle under way as well
    logical :: unfinished = .false.            !! whether there is one, behind those closed
    type(deviations_t) :: deviations           !! how they move, for tangent map and averages
    real(wp) :: graze_distance = 0             !! what is near, rad
    real(wp) :: count_depth = 0.01_wp          !! least depth of a counted flight / cycle's depth
    real(wp), pointer, contiguous :: log(:, :) => null()           !! (log_columns, room)
    real(wp), pointer, contiguous :: cycles(:, :) => null()        !! (cycle_columns ..., room)
    real(wp), pointer, contiguous :: tangent(:, :) => null()       !! (tangent_columns, room)
    real(wp), pointer, contiguous :: sample_time(:, :) => null()   !! (2, n): cycle, time in it
    real(wp), pointer, contiguous :: samples(:, :) => null()       !! (sample_columns, n)
    type(speed_density_t) :: density           !! speeds of impacts
    type(sums_t) :: sums
  end type recorder_t

contains

  !> Forget everything but the flight under way.
  subroutine start_recording(self)
    type(recorder_t), intent(inout) :: self
    self%sums%n_log = 0
    self%sums%n_cycles = 0
    self%sums%next_sample = 1
    self%sums%fastest = 0
  end subroutine start_recording

  !> A run goes on, or begins, watched by this recorder: what another that did not watch has left
  !> of a flight or of a cycle is no part of it.
  subroutine start_watching(self, in_flight)
    type(recorder_t), intent(inout) :: self
    logical, intent(in) :: in_flight             !! whether a flight is under way already
    logical :: cycles
    associate (sums => self%sums)
      if (watches_flights(self) .and. .not. sums%flights_watched) then
        sums%flight_known = merge(flight_in_part, flight_none, in_flight)
        sums%flight_depth = 0
        sums%flight_depth_before = 0
      end if
      cycles = self%want_strobe .or. self%want_cycles
      if (cycles .and. .not. sums%cycles_watched) then
        call forget_cycle(sums)
        sums%tangent = tangent_t()
      end if
      sums%flights_watched = watches_flights(self)
      sums%cycles_watched = cycles
    end associate
  end subroutine start_watching

  !> Another cycle begins, or nothing is known of the one under way.
  pure subroutine forget_cycle(sums)
    type(sums_t), intent(inout) :: sums
    sums%strobe_due = .true.
    sums%counter = 0
    sums%cycle_depth = 0
    sums%back_penetration = 0
    sums%states_visited = 0
    sums%n_flights = 0
    sums%averages = averages_t()
  end subroutine forget_cycle

  !> Columns behind those of every line of the cycle table that the averages take.
  pure integer function columns_of_averages(self)
    type(recorder_t), intent(in) :: self
    columns_of_averages = merge(average_columns, 0, self%want_averages)
  end function columns_of_averages

  !> Whether the depth of each flight is followed.
  pure logical function watches_flights(self)
    type(recorder_t), intent(in) :: self
    watches_flights = self%want_cycles .or. self%want_depths
  end function watches_flights

  !> Whether a run stops while its log is full, instead of going on without writing.
  pure logical function waits_for_room(self)
    type(recorder_t), intent(in) :: self
    waits_for_room = self%want_events .or. self%want_grazes
  end function waits_for_room

  !> Whether the log can take whatever one more segment may bring.
  pure logical function log_has_room(self)
    type(recorder_t), intent(in) :: self
    log_has_room = .true.
    if (.not. waits_for_room(self)) return
    log_has_room = self%sums%n_log + log_reserve <= size(self%log, 2)
  end function log_has_room

  !> Add a line to the log if it is wanted and there is room.
  subroutine log_line(self, event)
    type(recorder_t), intent(inout) :: self
    type(event_t), intent(in) :: event           !! the event
    logical :: is_impact, is_graze, wanted
    if (.not. (self%want_events .or. self%want_impacts .or. self%want_grazes)) return
    is_impact = event%kind <= event_kind(event_impact, coast_flank)
    is_graze = event%kind >= event_near_graze
    wanted = self%want_events .or. (self%want_impacts .and. is_impact) &
        .or. (self%want_grazes .and. is_graze)
    if (.not. wanted) return
    self%sums%n_log = self%sums%n_log + 1
    if (self%sums%n_log > size(self%log, 2)) return
    self%log(:, self%sums%n_log) = [real(event%kind, wp), real(event%cycle, wp), event%t, &
        event%phi, event%before, event%after, flight_before(self%sums, event%kind)]
  end subroutine log_line

  !> Depth of the flight that an event ends; NaN where it ends none, or one not watched throughout.
  pure real(wp) function flight_before(sums, kind) result(depth)
    type(sums_t), intent(in) :: sums             !! up to the event
    integer, intent(in) :: kind                  !! event_kind
    if (is_arrival(kind) .and. sums%flight_known == flight_whole) then
      depth = max(sums%flight_depth, sums%flight_depth_before)
    else
      depth = ieee_value(depth, ieee_quiet_nan)
    end if
  end function flight_before

  !> Whether an event ends a flight at a flank, by an impact or in contact.
  pure logical function is_arrival(kind)
    integer, intent(in) :: kind                  !! event_kind
    is_arrival = kind <= event_kind(event_impact, coast_flank) .or. (kind >= event_engage .and. &
        kind <= event_kind(event_engage, coast_flank))
  end function is_arrival
end module lapwing_observers_records

!> Observers: what a scene asks to be recorded, and nothing else.
module lapwing_recorder
  use lapwing_kinds, only: wp
  use lapwing_codes, only: separation, engagement, drive_flank, coast_flank, event_impact, &
      event_near_graze, event_kind
  use lapwing_damped, only: damped_t
  use lapwing_event_search, only: work_t
  use lapwing_hybrid_state, only: segment_t, event_t
  use lapwing_polynomial, only: max_degree, horner, bernstein, critical_points
  use lapwing_speed_density, only: speed_density_t, count_speed
  use lapwing_system, only: system_t, instant_t, frame_t, max_states
  use lapwing_tangent_map, only: tangent_t, carry_along, jump, tangent_row
  implicit none
  private
  public :: recorder_t, sums_t, record_segment, start_recording, log_columns, cycle_columns
  public :: sample_columns, log_has_room, look_ahead, sample_at, max_flights

  integer, parameter :: log_columns = 6       !! kind, cycle, t, phi, velocity before, after
  integer, parameter :: cycle_columns = 17    !! see `close_cycle`
  integer, parameter :: sample_columns = 3    !! motion state, phi, phi'
  integer, parameter :: n_counters = 8        !! impact, release, engage, chatter end, by flank
  !> Counted impacts of one cycle saturate here, those of shallower flights not included.
  integer, parameter :: max_flights = 1024
  !> A segment adds its four events and, at most now and then, a near-graze per piece and flank.
  integer, parameter :: log_reserve = 64

  !> What the statistics of a cycle still need when the cycle is cut.
  type :: sums_t
    integer :: n_log = 0                       !! lines in the log, also those it had no room for
    integer :: n_cycles = 0                    !! cycles closed
    integer :: next_sample = 1                 !! next sample of the history
    logical :: strobe_due = .true.             !! whether the cycle's first state is still to come
    real(wp) :: counter(n_counters) = 0        !! events of the cycle by kind
    real(wp) :: flight_depth = 0               !! deepest point of the flight in this cycle, rad
    real(wp) :: flight_depth_before = 0        !! and in the cycles before
    real(wp) :: cycle_depth = 0                !! deepest point of the cycle so far, rad
    real(wp) :: back_penetration = 0           !! deepest point in the coast flank, rad
    integer :: states_visited = 0              !! bit k: motion state k
    real(wp) :: strobe(3) = 0                  !! motion state, phi, phi' at the cycle's beginning
    real(wp) :: grazes_known_to = -1           !! near-grazes of the stretch up to here are logged
    integer :: n_flights = 0                   !! flights of the cycle ended by an impact
    real(wp) :: flight(max_flights) = 0        !! their depths, negative: at the coast flank
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
    type(damped_t) :: contact                  !! deviations in contact, for the tangent map
    real(wp) :: graze_distance = 0             !! what is near, rad
    real(wp) :: count_depth = 0.01_wp          !! least depth of a counted flight / cycle's depth
    real(wp), pointer, contiguous :: log(:, :) => null()           !! (log_columns, room)
    real(wp), pointer, contiguous :: cycles(:, :) => null()        !! (cycle_columns, room)
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
  end subroutine start_recording

  !> Whether the log can take whatever one more segment may bring.
  pure logical function log_has_room(self)
    type(recorder_t), intent(in) :: self
    log_has_room = .true.
    if (.not. (self%want_events .or. self%want_grazes)) return
    log_has_room = self%sums%n_log + log_reserve <= size(self%log, 2)
  end function log_has_room

  !> Record one segment. `before` is where it began.
  subroutine record_segment(self, system, segment, before, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(instant_t), intent(in) :: before        !! where it began
    type(work_t), intent(inout) :: work          !! counts
    integer :: i
    if (associated(self%samples)) then
      if (sample_is_near(self, segment)) call take_samples(self, system, segment, work)
    end if
    if (self%want_grazes .and. (segment%stepped .or. segment%closed)) then
      call find_grazes(self, system, segment, huge(1.0_wp), work)
      self%sums%grazes_known_to = -1
    end if
    if (self%want_strobe .or. self%want_cycles) call strobe(self, system, segment, before)
    if (self%want_cycles) call measure(self, system, segment, work)
    if (self%want_tangent) then
      call carry_along(self%sums%tangent, system, self%contact, segment, before)
    end if
    if (segment%cycle_completed .and. (self%want_strobe .or. self%want_cycles)) then
      call close_cycle(self, segment)
    end if
    if (self%want_tangent) call jump(self%sums%tangent, system, self%contact, segment)
    do i = 1, segment%n_events
      call log_line(self, segment%events(i))
      call count_speed(self%density, segment%events(i))
      if (self%want_cycles) call count_event(self, segment%events(i))
    end do
  end subroutine record_segment

  !> Record what lies before `until` in a segment that is about to be taken back.
  subroutine look_ahead(self, system, segment, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    real(wp), intent(in) :: until                !! time in the segment's cycle
    type(work_t), intent(inout) :: work          !! counts
    if (associated(self%samples)) then
      if (sample_is_near(self, segment)) call take_samples(self, system, segment, work)
    end if
    if (self%want_grazes .and. (segment%stepped .or. segment%closed) .and. until > segment%t) then
      call find_grazes(self, system, segment, until, work)
      self%sums%grazes_known_to = until
    end if
  end subroutine look_ahead

  !> The cycle's first state: where its first stretch of positive length begins.
  subroutine strobe(self, system, segment, before)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(instant_t), intent(in) :: before        !! where it began
    if (.not. self%sums%strobe_due .or. segment%length <= 0) return
    self%sums%strobe_due = .false.
    self%sums%strobe(1) = before%motion_state
    call system%observe(before, self%sums%strobe(2), self%sums%strobe(3))
  end subroutine strobe

  !> States visited, and the deepest points of flights and of back contact.
  subroutine measure(self, system, segment, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(work_t), intent(inout) :: work          !! counts
    associate (sums => self%sums)
      if (segment%length > 0) sums%states_visited = ibset(sums%states_visited, segment%motion_state)
      if (segment%closed) then
        call deepen_in_closed_form(system, segment, sums, work)
        return
      end if
      if (.not. segment%stepped) return
      if (segment%motion_state == separation) then
        call deepen(system, segment, drive_flank, 1.0_wp, sums%flight_depth, work)
        sums%cycle_depth = max(sums%cycle_depth, sums%flight_depth)
      else if (segment%motion_state /= engagement) then
        call deepen(system, segment, coast_flank, -1.0_wp, sums%back_penetration, work)
      end if
    end associate
  end subroutine measure

  !> The same for a stretch in closed form.
  subroutine deepen_in_closed_form(system, segment, sums, work)
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(sums_t), intent(inout) :: sums          !! deepest points so far
    type(work_t), intent(inout) :: work          !! counts
    if (segment%motion_state == engagement) return
    work%depth_searches = work%depth_searches + 1
    if (segment%motion_state == separation) then
      sums%flight_depth = system%deepest(segment%begin, drive_flank, segment%length, &
          sums%flight_depth)
      sums%cycle_depth = max(sums%cycle_depth, sums%flight_depth)
    else
      sums%back_penetration = system%deepest(segment%begin, coast_flank, segment%length, &
          sums%back_penetration)
    end if
  end subroutine deepen_in_closed_form

  !> Raise `deepest` to the largest sign*distance from a flank in a segment.
  !>
  !> Bernstein coefficients bound a piece from above, so that most pieces cost no root search.
  subroutine deepen(system, segment, flank, sign, deepest, work)
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: sign                 !! +1: distance, -1: penetration
    real(wp), intent(inout) :: deepest           !! largest so far, rad
    type(work_t), intent(inout) :: work          !! counts
    type(frame_t) :: frame
    real(wp) :: c(0:max_degree), length, at(max_degree)
    integer :: i, n
    frame = segment%frame
    do
      length = min(frame%piece_end, segment%length) - frame%piece_begin
      call system%gap(frame, flank, segment%motion, c)
      c = sign*c
      if (upper_bound(c, length) > deepest) then
        work%depth_searches = work%depth_searches + 1
        call critical_points(c, length, n, at)
        deepest = max(deepest, c(0), horner(c, length))
        do i = 1, n
          deepest = max(deepest, horner(c, at(i)))
        end do
      end if
      if (frame%piece_end >= segment%length) return
      call system%next_piece(frame)
    end do
  end subroutine deepen

  pure real(wp) function upper_bound(c, length)
    real(wp), intent(in) :: c(0:max_degree)  !! coefficients
    real(wp), intent(in) :: length           !! interval
    integer :: k
    upper_bound = maxval(bernstein(c*[(length**k, k = 0, max_degree)]))
  end function upper_bound

  !> Count an event in the cycle it falls in; an impact ends a flight.
  subroutine count_event(self, event)
    type(recorder_t), intent(inout) :: self
    type(event_t), intent(in) :: event           !! the event
    real(wp) :: depth
    associate (sums => self%sums)
      if (event%kind > n_counters) return
      sums%counter(event%kind) = sums%counter(event%kind) + 1
      depth = max(sums%flight_depth, sums%flight_depth_before)
      if (event%kind == event_impact) call push_flight(self, depth)
      if (event%kind == event_kind(event_impact, coast_flank)) call push_flight(self, -depth)
      sums%flight_depth = 0
      sums%flight_depth_before = 0
    end associate
  end subroutine count_event

  !> Keep the depth of a flight that an impact has ended, until the cycle's depth is known.
  subroutine push_flight(self, depth)
    type(recorder_t), intent(inout) :: self
    real(wp), intent(in) :: depth                !! rad, negative: ended at the coast flank
    associate (sums => self%sums)
      if (sums%n_flights == max_flights) call forget_shallow(self)
      if (sums%n_flights == max_flights) return
      sums%n_flights = sums%n_flights + 1
      sums%flight(sums%n_flights) = depth
    end associate
  end subroutine push_flight

  !> Drop flights too shallow to be counted: the cycle's depth can only grow.
  subroutine forget_shallow(self)
    type(recorder_t), intent(inout) :: self
    integer :: i, kept
    kept = 0
    do i = 1, self%sums%n_flights
      if (.not. abs(self%sums%flight(i)) > self%count_depth*self%sums%cycle_depth) cycle
      kept = kept + 1
      self%sums%flight(kept) = self%sums%flight(i)
    end do
    self%sums%n_flights = kept
  end subroutine forget_shallow

  !> Write the cycle's line and begin the next.
  subroutine close_cycle(self, segment)
    type(recorder_t), intent(inout) :: self
    type(segment_t), intent(in) :: segment       !! segment that ends the cycle
    integer :: counted, counted_back
    associate (sums => self%sums)
      call forget_shallow(self)
      counted = 0
      if (sums%n_flights > 0) counted = count(sums%flight(1:sums%n_flights) > 0)
      counted_back = sums%n_flights - counted
      sums%n_cycles = sums%n_cycles + 1
      if (sums%n_cycles <= size(self%cycles, 2)) then
        self%cycles(:, sums%n_cycles) = [real(segment%cycle, wp), sums%strobe, &
            sums%counter(1:2), real([counted, counted_back], wp), sums%counter(3:8), &
            sums%cycle_depth, sums%back_penetration, real(sums%states_visited, wp)]
      end if
      if (self%want_tangent) then
        if (sums%n_cycles <= size(self%tangent, 2)) then
          self%tangent(:, sums%n_cycles) = tangent_row(sums%tangent)
        end if
        sums%tangent = tangent_t()
      end if
      sums%strobe_due = .true.
      sums%counter = 0
      sums%cycle_depth = 0
      sums%flight_depth_before = max(sums%flight_depth, sums%flight_depth_before)
      sums%flight_depth = 0
      sums%back_penetration = 0
      sums%states_visited = 0
      sums%n_flights = 0
    end associate
  end subroutine close_cycle

  !> Add a line to the log if it is wanted and there is room.
  subroutine log_line(self, event)
    type(recorder_t), intent(inout) :: self
    type(event_t), intent(in) :: event           !! the event
    logical :: is_impact, is_graze, wanted
    is_impact = event%kind <= event_kind(event_impact, coast_flank)
    is_graze = event%kind >= event_near_graze
    wanted = self%want_events .or. (self%want_impacts .and. is_impact) &
        .or. (self%want_grazes .and. is_graze)
    if (.not. wanted) return
    self%sums%n_log = self%sums%n_log + 1
    if (self%sums%n_log > size(self%log, 2)) return
    self%log(:, self%sums%n_log) = [real(event%kind, wp), real(event%cycle, wp), event%t, &
        event%phi, event%before, event%after]
  end subroutine log_line

  !> Log where a segment comes near a flank, or near release, and turns back.
  subroutine find_grazes(self, system, segment, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    type(frame_t) :: frame
    integer :: flank
    frame = segment%frame
    if (segment%closed) then
      do flank = 1, system%n_flanks
        if (segment%motion_state /= separation .and. segment%motion_state /= flank) cycle
        call grazes_in_closed_form(self, system, segment, flank, until, work)
      end do
      return
    end if
    do
      do flank = 1, system%n_flanks
        if (segment%motion_state /= separation .and. segment%motion_state /= flank) cycle
        call graze_on_piece(self, system, segment, frame, flank, until, work)
      end do
      if (frame%piece_end >= segment%length) return
      call system%next_piece(frame)
    end do
  end subroutine find_grazes

  !> Near-grazes of one flank on one piece.
  subroutine graze_on_piece(self, system, segment, frame, flank, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(frame_t), intent(in) :: frame           !! frame on the piece
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: c(0:max_degree), length, at(max_degree), distance
    type(instant_t) :: instant
    integer :: i, n
    length = min(frame%piece_end, segment%length) - frame%piece_begin
    call system%gap(frame, flank, segment%motion, c)
    if (segment%motion_state /= separation) c = -c
    if (-upper_bound(-c, length) > self%graze_distance) return
    work%graze_searches = work%graze_searches + 1
    call critical_points(c, length, n, at)
    do i = 1, n
      distance = horner(c, at(i))
      if (distance <= 0 .or. distance > self%graze_distance) cycle
      if (horner(c, at(i) - 1.0e-3_wp*length) < distance) cycle
      call instant_in_segment(system, segment, frame, frame%piece_begin + at(i), instant)
      call log_graze(self, system, segment, flank, instant, until)
    end do
  end subroutine graze_on_piece

  !> Near-grazes of one flank on a stretch in closed form.
  subroutine grazes_in_closed_form(self, system, segment, flank, until, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    integer, intent(in) :: flank                 !! flank
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: from, s, distance, bend, inward
    type(instant_t) :: instant
    logical :: found
    work%graze_searches = work%graze_searches + 1
    inward = merge(1.0_wp, -1.0_wp, segment%motion_state == separation)
    from = 0
    do
      call system%turn(segment%begin, flank, from, segment%length, found, s, distance, bend)
      if (.not. found) return
      distance = inward*distance
      if (distance > 0 .and. distance <= self%graze_distance .and. inward*bend > 0) then
        call instant_in_segment(system, segment, segment%frame, s, instant)
        call log_graze(self, system, segment, flank, instant, until)
      end if
      from = s
    end do
  end subroutine grazes_in_closed_form

  !> Log a near-graze in the time asked about.
  subroutine log_graze(self, system, segment, flank, instant, until)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    integer, intent(in) :: flank                 !! flank
    type(instant_t), intent(in) :: instant       !! where the distance turns
    real(wp), intent(in) :: until                !! time in the cycle: later ones wait
    type(event_t) :: event
    if (instant%t <= self%sums%grazes_known_to .or. instant%t > until) return
    event%kind = event_kind(event_near_graze, flank)
    event%cycle = segment%cycle
    event%t = instant%t
    call system%observe(instant, event%phi, event%before)
    event%after = event%before
    call log_line(self, event)
  end subroutine log_graze

  !> Whether the next sample may fall in a segment.
  pure logical function sample_is_near(self, segment)
    type(recorder_t), intent(in) :: self
    type(segment_t), intent(in) :: segment       !! what happened
    sample_is_near = self%sums%next_sample <= size(self%samples, 2)
    if (.not. sample_is_near) return
    sample_is_near = self%sample_time(1, self%sums%next_sample) < segment%cycle + 0.5_wp
  end function sample_is_near

  !> Samples of the history that fall in a segment.
  subroutine take_samples(self, system, segment, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(work_t), intent(inout) :: work          !! counts
    type(frame_t) :: frame
    type(instant_t) :: instant
    real(wp) :: s
    frame = segment%frame
    do while (self%sums%next_sample <= size(self%samples, 2))
      associate (time => self%sample_time(:, self%sums%next_sample))
        if (time(1) > segment%cycle + 0.5_wp) return
        s = time(2) - segment%t
        if (s >= segment%length .and. .not. segment%cycle_completed) return
      end associate
      do while (.not. segment%closed)
        if (s <= frame%piece_end .or. frame%piece_end >= segment%length) exit
        call system%next_piece(frame)
      end do
      call instant_in_segment(system, segment, frame, s, instant)
      call sample_at(self, system, instant, work)
    end do
  end subroutine take_samples

  !> Write the next sample.
  subroutine sample_at(self, system, instant, work)
    type(recorder_t), intent(inout) :: self
    class(system_t), intent(in) :: system        !! what moves
    type(instant_t), intent(in) :: instant       !! where it is
    type(work_t), intent(inout) :: work          !! counts
    real(wp) :: phi, phi_dot
    call system%observe(instant, phi, phi_dot)
    self%samples(:, self%sums%next_sample) = [real(instant%motion_state, wp), phi, phi_dot]
    self%sums%next_sample = self%sums%next_sample + 1
    work%samples = work%samples + 1
  end subroutine sample_at

  !> Where the system is at s within a segment.
  subroutine instant_in_segment(system, segment, frame, s, instant)
    class(system_t), intent(in) :: system        !! what moves
    type(segment_t), intent(in) :: segment       !! what happened
    type(frame_t), intent(in) :: frame           !! frame on the piece that holds s
    real(wp), intent(in) :: s                    !! time since the segment began
    type(instant_t), intent(out) :: instant      !! where it is
    real(wp) :: z(max_states)
    integer :: i
    instant%motion_state = segment%motion_state
    instant%chart = frame%chart
    instant%cycle = segment%cycle
    instant%t = segment%t + s
    instant%piece = frame%piece
    if (segment%closed) call system%inside(segment%begin, s, instant%y)
    if (.not. segment%stepped) return
    z = 0
    do i = 1, system%n_states
      z(i) = horner(segment%motion%dense(:, i), s/segment%motion%h)
    end do
    call system%commit(frame, s, z, frame%chart, instant%y)
  end subroutine instant_in_segment
end module lapwing_recorder

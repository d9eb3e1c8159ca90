MODULE {{ program }}
  ! {{ about }}
  ! Ways from pose to pose were checked against what is known of the cell: floor, boxes, instrument, the arm.
  ! What is not known was not checked. Run it slowly first, a hand on the stop.
  ! Joint values in degrees. Every move ends at rest (fine).
  ! The joint values that were reached go to HOME:{{ program }}.csv, written anew at each run.
  CONST speeddata slow:=[100,30,100,30]; ! mm/s of the tool, deg/s
  VAR iodev joints_file;

  PROC run_{{ program }}()
    AccSet 30,30;
    Open "HOME:" \File:="{{ program }}.csv",joints_file \Write;
    Write joints_file,"pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg";
{% for step in steps %}
{% for line in step.ask | lines %}
    TPWrite "{{ line }}";
{% if loop.last %}
    Stop;
{% endif %}
{% endfor %}
{% for point in step.way + (step.target,) %}
    MoveAbsJ [[{{ point | deg | join(",") }}],[9E9,9E9,9E9,9E9,9E9,9E9]]\NoEOffs,slow,fine,tool0; ! {{ point | label }}
{% endfor %}
    measure_here "{{ step.target | label }}";
{% endfor %}
    Close joints_file;
  ENDPROC

  PROC measure_here(string label) ! what is done at each pose: write here how your instrument is triggered
    VAR jointtarget joints;
    WaitTime\InPos,1.0; ! s, to settle
    joints:=CJointT();
    Write joints_file,label+","+NumToStr(joints.robax.rax_1,4)+","+NumToStr(joints.robax.rax_2,4)+","\NoNewLine;
    Write joints_file,NumToStr(joints.robax.rax_3,4)+","+NumToStr(joints.robax.rax_4,4)+","\NoNewLine;
    Write joints_file,NumToStr(joints.robax.rax_5,4)+","+NumToStr(joints.robax.rax_6,4);
    ! PulseDO\PLength:=0.2,doMeasure;
    WaitTime 3.0; ! s, while it measures
  ENDPROC
ENDMODULE
